"""Friction of surfaces: within what handbooks say of pairs, simulated so, and recorded so."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from worlds import put, recorder_of, world_of

from simulate.catalogue.objects import ObjectModel, Shape, catalogue
from simulate.catalogue.surfaces import HANDBOOK, SURFACES, Pair, friction

pytestmark = pytest.mark.simulate


@pytest.mark.parametrize("pair", HANDBOOK, ids=lambda pair: f"{pair.first}-{pair.second}")
def test_the_rougher_surface_gives_what_handbooks_say_of_the_pair(pair: Pair) -> None:
    assert pair.least <= max(SURFACES[pair.first], SURFACES[pair.second]) <= pair.most


def test_every_thing_is_of_a_surface_that_is_known() -> None:
    things = [model for model in catalogue().values() if not model.region]
    assert all(model.surface or model.material for model in things)
    assert len({model.friction[0] for model in things}) >= 8
    with pytest.raises(ValidationError, match="no friction is known of 'brass'"):
        ObjectModel(
            mass=1, height=0.1, material="brass", shapes=(Shape(kind="sphere", size=(0.05,)),)
        )


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


def test_what_is_recorded_is_what_was_simulated() -> None:
    world = world_of("tumbler", "mat")
    put(world, tumbler=[0.5, 0.0, 0.004], mat=[0.5, 0.0, 0.0])
    bodies = {body.name: body for body in recorder_of(world).writer.header.bodies}
    of = {name: {geom.friction for geom in bodies[name].geoms} for name in bodies}
    assert of["tumbler"] == {friction("glass")}
    assert of["mat"] == {friction("cork")}
    assert of["table"] == {friction("wood")}
    assert {rough[0] for rough in of["robot_left_pad"]} == {SURFACES["rubber"]}
    world.act(np.append(world.arm_position, 0.0))
    met = world.data.contact
    pairs = {
        tuple(sorted(world.model.body(world.model.geom_bodyid[g]).name for g in geoms)): rough[0]
        for geoms, rough in zip(met.geom, met.friction, strict=True)
    }
    assert pairs["mat", "tumbler"] == SURFACES["cork"]
    assert pairs["mat", "table"] == SURFACES["cork"]
