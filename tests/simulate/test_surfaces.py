"""Friction of surfaces: within what handbooks say of pairs, simulated so, and recorded so."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import put, world_of

from simulate.catalogue.objects import catalogue
from simulate.catalogue.surfaces import HANDBOOK, SURFACES, Pair, friction

pytestmark = pytest.mark.simulate


@pytest.mark.parametrize("pair", HANDBOOK, ids=lambda pair: f"{pair.first}-{pair.second}")
def test_the_rougher_surface_gives_what_handbooks_say_of_the_pair(pair: Pair) -> None:
    assert pair.least <= max(SURFACES[pair.first], SURFACES[pair.second]) <= pair.most


@pytest.mark.parametrize("name", ["biscuit_tin", "cereal_box", "soap", "cutting_board"])
def test_it_slides_where_the_slope_is_steeper_than_its_friction(name: str) -> None:
    """Gravity leans instead of the table; on wood the rougher of both counts."""
    rough = max(catalogue()[name].friction[0], friction("wood")[0])
    for share, slides in ((0.85, False), (1.15, True)):
        world = world_of(name)
        put(world, **{name: [0.5, 0.0, 0.0]})
        angle = np.arctan(share * rough)
        if name == "cereal_box":  # it would topple
            world.data.joint(f"{name}/free").qpos[2:7] = 0.03, np.sqrt(0.5), 0, np.sqrt(0.5), 0
        world.model.opt.gravity[:] = 9.81 * np.array([0, np.sin(angle), -np.cos(angle)])
        for _ in range(15):
            world.act(np.append(world.arm_position, 0.0))
        moved = float(world.object_poses()[name][1])
        assert moved > 0.1 if slides else moved < 0.02, share
