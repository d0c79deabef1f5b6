"""Forces that balance act only where contacts, giving a little, come to exert them."""

from __future__ import annotations

import numpy as np
import pytest
from balances import motion, unbalanced
from numpy.typing import NDArray

from safestage_eval.relations.reached import GRAVITY
from safestage_eval.relations.statics import Bodies, Touches

F64 = NDArray[np.float64]
LEVEL = (0.0, 0.0)


def cube(side: float = 0.1, mass: float = 1.0) -> Bodies:
    """One, its centre at the origin."""
    return Bodies(np.array([mass]), np.zeros((1, 3)), np.eye(3)[None] * (mass * side**2 / 6))


def corners(at: F64, normal: tuple[float, float, float], friction: float) -> Touches:
    """Points (C, 3) in which the ground touches the one body."""
    count = len(at)
    return Touches(
        np.full(count, -1), np.zeros(count, np.int64), np.asarray(at, np.float64),
        np.tile(normal, (count, 1)).astype(np.float64), np.full(count, friction),
    )  # fmt: skip


FEET = 0.05 * np.array([[x, y, -1.0] for x in (-1, 1) for y in (-1, 1)])


def wedged(friction: float) -> Touches:
    """A cube between two walls that nothing presses on it, and no ground."""
    sides = [0.05 * np.array([[s, y, z] for y in (-1, 1) for z in (-1, 1)]) for s in (-1.0, 1.0)]
    both = [corners(at, (-s, 0, 0), friction) for at, s in zip(sides, (-1, 1), strict=True)]
    return Touches(*(np.concatenate(values) for values in zip(*both, strict=True)))


@pytest.mark.parametrize("force", [0.0, GRAVITY / 4, 5.0])
def test_what_stands_on_its_feet_is_held_whatever_the_forces_were(force: float) -> None:
    feet = corners(FEET, (0, 0, 1), 0.5)
    assert unbalanced(cube(), feet, np.tile([0, 0, force], (4, 1)), LEVEL).max() < 0.005


def test_what_nothing_touches_falls_as_fast_as_anything() -> None:
    nothing = corners(np.zeros((0, 3)), (0, 0, 1), 0.5)
    assert unbalanced(cube(), nothing, np.zeros((0, 3)), LEVEL) == pytest.approx([1.0])


def test_a_side_that_nothing_bears_tips() -> None:
    half = corners(FEET[:2], (0, 0, 1), 0.9)
    assert unbalanced(cube(), half, np.tile([0, 0, GRAVITY / 2], (2, 1)), LEVEL)[0] > 0.1


@pytest.mark.parametrize(("friction", "stays"), [(0.5, True), (0.15, False)])
def test_a_push_slides_what_friction_does_not_hold(friction: float, stays: bool) -> None:
    feet, weight = corners(FEET, (0, 0, 1), friction), np.tile([0, 0, GRAVITY / 4], (4, 1))
    moved = unbalanced(cube(), feet, weight, (0.3, 0.0))[0]
    assert moved < 0.005 if stays else moved == pytest.approx(0.3 - friction, abs=0.02)


def test_walls_hold_by_friction_only_what_they_press() -> None:
    """Forces that would wedge it exist at once; they are there only if the walls already press."""
    between = wedged(0.8)
    assert motion(cube(), between).max() < 0.005
    press = np.where(between.normal > 0, 3.0, -3.0) * np.abs(between.normal)
    assert unbalanced(cube(), between, press, LEVEL).max() < 0.005
    assert unbalanced(cube(), between, np.zeros((8, 3)), LEVEL)[0] > 0.5


def test_the_unit_of_mass_makes_no_difference() -> None:
    half = corners(FEET[:3] + np.array([0.004, 0.0, 0.0]), (0, 0, 1), 0.3)
    forces = np.tile([0, 0, GRAVITY / 3], (3, 1))
    heavy = unbalanced(cube(mass=1000.0), half, 1000.0 * forces, (0.02, 0.0))
    assert heavy == pytest.approx(unbalanced(cube(), half, forces, (0.02, 0.0)), abs=1e-6)
