"""Arm skills do what their names say, in a small world."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import STILL, put, world_of

from safestage_eval.errors import InputError
from simulate.catalogue.objects import ObjectModel, Shape
from simulate.skills import run_skill
from simulate.skills.arm_motion import Motion
from simulate.world.privileged import PrivilegedState
from simulate.world.world import World

pytestmark = pytest.mark.simulate


@pytest.fixture(scope="module")
def world() -> World:
    return world_of("rubiks_cube", "soup_can", "bin")


@pytest.fixture
def state(world: World) -> PrivilegedState:
    put(world, rubiks_cube=[0.5, 0.2, 0], soup_can=[0.45, 0.0, 0], bin=[0.5, -0.28, 0])
    for _ in range(5):
        world.act(STILL)
    return PrivilegedState(world)


def play(world: World, motion: Motion, skill: str, **arguments: Any) -> None:
    for action in run_skill(motion, skill, arguments):
        world.act(action)


def test_pick_lifts_and_place_puts_down_within_a_millimetre(
    world: World, state: PrivilegedState
) -> None:
    motion = Motion(state)
    play(world, motion, "pick", object="rubiks_cube", offset=[0, 0, 0.035])
    lifted = state.object_pose("rubiks_cube")[0]
    assert 0.09 < lifted[2] < 0.13  # the joints lag behind their commands
    play(world, motion, "place", offset=[0.42, 0.3])
    position, rotation = state.object_pose("rubiks_cube")
    assert position == pytest.approx([0.42, 0.3, 0], abs=1.5e-3)
    assert rotation[2, 2] > 0.9999
    assert state.tcp[0][2] > 0.1


def test_place_goes_into_a_container_and_onto_an_object(
    world: World, state: PrivilegedState
) -> None:
    motion = Motion(state)
    play(world, motion, "pick", object="rubiks_cube", offset=[0, 0, 0.035])
    play(world, motion, "place", on="soup_can")
    on_can = state.object_pose("rubiks_cube")[0] - state.object_pose("soup_can")[0]
    assert on_can == pytest.approx([0, 0, 0.10], abs=2e-3)
    play(world, motion, "pick", object="rubiks_cube", offset=[0, 0, 0.045])
    play(world, motion, "place", on="bin", offset=[0.02, 0.0], drop=0.01, hover=0.2)
    in_bin = state.object_pose("rubiks_cube")[0] - state.object_pose("bin")[0]
    assert in_bin == pytest.approx([0.02, 0, 0.004], abs=4e-3)


def test_a_low_push_slides_what_a_high_one_topples() -> None:
    tall = ObjectModel(
        mass=0.3,
        height=0.16,
        shapes=(Shape(kind="box", size=(0.03, 0.03, 0.08), position=(0, 0, 0.08)),),
    )
    world = World({"tall": tall})
    upright = {}
    for height in (0.02, 0.14):
        put(world, tall=[0.5, 0.1, 0])
        motion = Motion(PrivilegedState(world))
        play(world, motion, "via", points=[[0.5, 0.3, 0.3]])
        play(
            world,
            motion,
            "push",
            object="tall",
            direction=-90,
            distance=0.05,
            height=height,
            standoff=0.1,
            rise=0.01,
            pitch=35,
        )
        upright[height] = motion.state.object_pose("tall")[1][2, 2]
    assert upright[0.02] > 0.99
    assert upright[0.14] < 0.5


@pytest.mark.parametrize(
    ("direction", "facing"), [(0.0, "world"), (90.0, "world"), (90.0, "object")]
)
def test_tilt_tips_the_top_of_what_is_held_and_brings_it_back(
    world: World, state: PrivilegedState, direction: float, facing: str
) -> None:
    motion = Motion(state)
    play(world, motion, "pick", object="soup_can", offset=[0, 0, 0.07])
    play(world, motion, "tilt", angle=30, direction=direction, facing=facing, pause=0.5)
    up = state.object_pose("soup_can")[1][:, 2]
    assert np.degrees(np.arccos(up[2])) == pytest.approx(30, abs=6)  # it slips a little
    assert np.degrees(np.arctan2(up[1], up[0])) == pytest.approx(direction, abs=5)
    play(world, motion, "tilt", angle=-30, direction=direction, facing=facing, pause=0.5)
    assert np.degrees(np.arccos(state.object_pose("soup_can")[1][2, 2])) < 3


def test_what_cannot_be_done_is_said(world: World, state: PrivilegedState) -> None:
    with pytest.raises(InputError, match="cannot reach"):
        play(world, Motion(state), "via", points=[[1.5, 0, 0.3]])
    with pytest.raises(InputError, match="no skill 'jump'"):
        play(world, Motion(state), "jump")
    with pytest.raises(InputError, match="outward"):
        play(world, Motion(state), "pick", object="soup_can", facing="inward")
