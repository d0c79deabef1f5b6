"""Rooms and light: drawn from numbers, within the ranges that are stated, and different."""

from __future__ import annotations

import numpy as np
import pytest

from simulate.arm import droid
from simulate.looks.room import FLOORS, TABLES, WALLS, Look, look_numbers

pytestmark = pytest.mark.simulate

LOOKS = [Look.drawn(task, seed) for task in range(40) for seed in range(3)]


def test_the_same_numbers_give_the_same_look() -> None:
    assert Look.drawn(5, 1) == Look.drawn(5, 1) != Look.drawn(5, 2)
    assert look_numbers("fsh_orange_on_plate", 3) == look_numbers("fsh_orange_on_plate", 3)
    assert look_numbers("fsh_orange_on_plate", 3) != look_numbers("fsh_apple_into_bowl", 3)


def test_every_table_floor_and_wall_comes() -> None:
    assert {look.table for look in LOOKS} == set(range(len(TABLES)))
    assert {look.floor for look in LOOKS} == set(range(len(FLOORS)))
    assert {look.wall for look in LOOKS} == set(range(len(WALLS)))


def test_light_is_neither_dark_nor_blinding() -> None:
    """A white sheet that lies is between grey and just white; the lamp is above the table."""
    for look in LOOKS:
        key = look.lamps[0]
        assert key.shadow
        assert np.linalg.norm(key.direction) == pytest.approx(1)
        assert key.direction[2] <= -np.cos(np.radians(50)) + 1e-9
        assert key.position[2] > 1.1, "above the raised arm"
        lit = np.array(look.ambient) + 0.16
        for lamp in look.lamps:
            lit += np.array(lamp.color) * -lamp.direction[2]
        assert 0.6 < lit.min() <= lit.max() < 1.3, lit
    warmth = [look.lamps[0].color[0] / look.lamps[0].color[2] for look in LOOKS]
    assert min(warmth) < 1 < max(warmth)


def test_outer_cameras_stand_near_their_places_and_look_at_the_table() -> None:
    """At most 3 cm and about 2 degrees each way off; the table's middle is well in the picture."""
    for look in LOOKS[:30]:
        there = droid.outside_cameras(look.seed)
        assert there == droid.outside_cameras(look.seed)
        for name, at in there.items():
            nominal = droid.OUTSIDE[name]
            assert np.abs(np.subtract(at.position, nominal.position)).max() <= droid.SHIFT
            w, x, y, z = at.orientation
            back = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
            aim = np.subtract((0.5, 0.0, 0.0), at.position)
            aim /= np.linalg.norm(aim)
            assert np.degrees(np.arccos(-back @ aim)) < 15, name


def test_the_outer_cameras_field_of_view_is_that_of_a_zed_2() -> None:
    """A focal length of 528 pixels at 720 rows, within a per cent of it."""
    for camera in droid.OUTSIDE.values():
        focal = 360 / np.tan(np.radians(camera.fovy / 2))
        assert focal == pytest.approx(528, rel=0.01)
