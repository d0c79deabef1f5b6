"""How far from the edge: straight edges, corners, rims, walls, several geoms."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from bodies import box, cylinder, put, shape, sphere
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.episode import Geom, Mesh
from safestage_eval.geometry import pose
from safestage_eval.geometry.edge import edge_margin
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.shape import BodyShape

MM = 1e-3
CAN = cylinder(0.03, 0.06)
TABLE = put(box(0.5, 0.3, 0.01), (0, 0, -0.01))
BOARDS = [box(0.1, 0.3, 0.01, at=(x, 0, -0.01)) for x in (-0.4, -0.2, 0, 0.2, 0.4)]
SHELF = put(shape(*BOARDS, box(0.5, 0.01, 0.2, at=(0, 0.29, 0.2))), (0, 0, 0))


def margin(a: Mover, *supports: Mover, around: Sequence[Mover] = (), drop: float = 0.02) -> float:
    return float(edge_margin(a, supports, around=around, drop=drop)[0])


def ring(radius: float, height: float) -> list[Geom]:
    """A rim of 24 small boxes around the origin, from 0 up."""
    geoms = []
    for angle in np.arange(24) * 2 * np.pi / 24:
        turn = (np.cos(angle / 2), 0, 0, np.sin(angle / 2))
        at = (radius * np.cos(angle), radius * np.sin(angle), height / 2)
        half = (0.004, radius * 0.15, height / 2)
        geoms.append(Geom(kind="box", size=half, position=at, orientation=turn))
    return geoms


@pytest.mark.parametrize("y", [0.0, -0.2, -0.26, -0.27, -0.28, -0.3, -0.32])
@pytest.mark.parametrize("support", [TABLE, SHELF], ids=["one box", "five boards and a back wall"])
def test_straight_edge(support: Mover, y: float) -> None:
    """Positive inside, zero at the edge, negative by how far it sticks out."""
    assert margin(put(CAN, (0.05, y, 0.06)), support) == pytest.approx(0.3 - 0.03 + y, abs=0.1 * MM)


def test_the_nearest_of_all_edges_counts_and_seams_do_not() -> None:
    assert margin(put(CAN, (0.1, 0, 0.06)), SHELF) == pytest.approx(0.27, abs=0.1 * MM)
    assert margin(put(CAN, (0.4, 0, 0.06)), SHELF) == pytest.approx(0.07, abs=0.1 * MM)
    assert margin(put(box(0.03, 0.03, 0.06), (0.4, 0.1, 0.06)), TABLE) == pytest.approx(0.07)


@pytest.mark.parametrize(("slope", "stands"), [(10, True), (28, True), (32, False)])
def test_a_slope_is_stood_on_up_to_thirty_degrees(slope: float, stands: bool) -> None:
    """A small ball in the middle of a slab: 30 cm to its level sides, less than half a metre down."""
    half = np.deg2rad(slope) / 2
    turn = np.array([np.cos(half), 0, np.sin(half), 0])
    up = np.array([np.sin(2 * half), 0, np.cos(2 * half)])
    slab = put(box(0.5, 0.3, 0.01), -0.01 * up, turn)
    found = margin(put(sphere(0.004), 0.004 * up + [0.1, 0, -0.1 * np.tan(2 * half)]), slab)
    foot = np.sqrt(0.004**2 - 0.003**2)  # half of it, seen 1 mm up
    assert found == pytest.approx(0.3 - foot, abs=0.2 * MM) if stands else np.isnan(found)


def test_a_back_wall_guards_its_edge() -> None:
    """Next to the wall and far from the front: the front counts. Without the wall the back does."""
    behind = put(CAN, (0, 0.24, 0.06))
    assert margin(behind, SHELF) == pytest.approx(0.5 - 0.03, abs=0.1 * MM)
    assert margin(behind, TABLE) == pytest.approx(0.03, abs=0.1 * MM)
    touching = put(CAN, (0, 0.2505, 0.0595))
    assert margin(touching, SHELF) > 0.4


@pytest.mark.parametrize(("rim", "guards"), [(0.008, False), (0.012, True)])
def test_a_rim_guards_when_it_is_a_centimetre_high(rim: float, guards: bool) -> None:
    disc = Geom(kind="cylinder", size=(0.15, 0.004), position=(0, 0, -0.004))
    plate = put(shape(disc, *ring(0.146, rim)), (0.3, 0.1, 0.8))
    found = margin(put(sphere(0.035), (0.35, 0.1, 0.835)), plate)
    foot = np.sqrt(0.035**2 - 0.034**2)
    assert found == (np.inf if guards else pytest.approx(0.15 - 0.05 - foot, abs=0.2 * MM))


def test_in_a_bin_nothing_can_fall_on_its_wall_it_can() -> None:
    walls = [box(0.005, 0.1, 0.05, at=(s * 0.095, 0, 0.05)) for s in (-1, 1)]
    walls += [box(0.1, 0.005, 0.05, at=(0, s * 0.095, 0.05)) for s in (-1, 1)]
    container = put(shape(box(0.1, 0.1, 0.005, at=(0, 0, -0.005)), *walls), (0, 0, 0))
    assert margin(put(CAN, (0.02, 0, 0.06)), container) == np.inf
    assert margin(put(CAN, (0.0604, 0, 0.0596)), container) == np.inf
    on_wall = put(box(0.003, 0.01, 0.01), (0.095, 0, 0.11))
    assert margin(on_wall, container) == pytest.approx(2 * MM, abs=0.1 * MM)


def test_two_bodies_make_one_surface() -> None:
    left, right = (
        put(box(0.1, 0.1, 0.01), (-0.1, 0, -0.01)),
        put(box(0.1, 0.1, 0.01), (0.1, 0, -0.01)),
    )
    can = put(CAN, (0, 0, 0.06))
    assert margin(can, left, right) == pytest.approx(0.07, abs=0.1 * MM)
    assert margin(can, left) == pytest.approx(-0.03, abs=0.1 * MM)


@pytest.mark.parametrize("half_y", [0.02, 0.04])
@pytest.mark.parametrize("reach", [0.10, 0.14])
def test_a_board_on_two_piers_spans_the_gap(half_y: float, reach: float) -> None:
    """Piers 10 × 10 cm at x = ±12 cm: their outer edges are at 17 cm, their sides at 5 cm."""
    piers = [put(box(0.05, 0.05, 0.05), (x, 0, -0.05)) for x in (-0.12, 0.12)]
    board = put(box(reach, half_y, 0.01), (0, 0, 0.01))
    assert margin(board, *piers) == pytest.approx(min(0.05 - half_y, 0.17 - reach), abs=0.1 * MM)
    longer = put(box(0.2, half_y, 0.01), (0, 0, 0.01))
    assert margin(longer, *piers) == pytest.approx(-0.03, abs=0.1 * MM)
    assert margin(board, piers[0]) < -0.09


def test_a_lid_spans_the_pot_and_a_can_at_a_hole_does_not() -> None:
    frame = [box(0.1, 0.01, 0.01, at=(0, s * 0.09, -0.01)) for s in (-1, 1)]
    frame += [box(0.01, 0.08, 0.01, at=(s * 0.09, 0, -0.01)) for s in (-1, 1)]
    pot = put(shape(*frame), (0, 0, 0))
    assert margin(put(box(0.095, 0.095, 0.005), (0, 0, 0.005)), pot) == pytest.approx(0.005)
    assert margin(put(box(0.095, 0.03, 0.005), (0, 0, 0.005)), pot) == pytest.approx(0.005)
    assert margin(put(box(0.012, 0.03, 0.005), (0.085, 0, 0.005)), pot) < 0
    wide = shape(
        box(0.5, 0.2, 0.01, at=(0, -0.2, -0.01)), box(0.2, 0.2, 0.01, at=(-0.3, 0.2, -0.01))
    )
    assert margin(put(CAN, (-0.09, 0.02, 0.06)), put(wide, (0, 0, 0))) < 0


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, deadline=None, max_examples=15)
def test_turning_the_whole_scene_about_the_vertical_changes_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, y, spin = rng.uniform(-0.5, 0.5), rng.uniform(-0.32, 0.24), rng.uniform(0, 7)
    block = shape(box(0.03, 0.02, 0.05))
    at, q = (x, y, 0.05), (np.cos(spin / 2), 0, 0, np.sin(spin / 2))
    turn = pose.unit([rng.normal(), 0, 0, rng.normal()])
    shift = rng.normal(size=3)
    here = margin(put(block, at, q), SHELF)
    there = margin(put(block, *pose.compose(shift, turn, at, q)), put(SHELF.shape, shift, turn))
    assert there == pytest.approx(here, abs=1e-6, nan_ok=True)


# ---- surfaces of several bodies; a can, radius 3 cm, on a slab 20 × 20 cm whose top is at z = 0

SLAB = put(box(0.1, 0.1, 0.05), (0, 0, -0.05))


def can(x: float, y: float = 0.0, z: float = 0.0) -> Mover:
    return put(CAN, (x, y, z + 0.06))


@pytest.mark.parametrize("step", [-0.019, -0.01, -0.005, 0.005, 0.009])
def test_a_small_step_is_no_edge_and_what_lies_beyond_it_has_edges(step: float) -> None:
    other = put(box(0.02, 0.5, 0.05), (0.12, 0, -0.05 + step))
    assert margin(can(0.06), SLAB, around=[other]) == pytest.approx(0.05, abs=0.1 * MM)
    assert margin(can(0.06), SLAB, around=[other], drop=0.0045) == pytest.approx(0.01, abs=0.1 * MM)


@pytest.mark.parametrize("step", [-0.021, -0.05])
def test_a_large_step_down_is_an_edge(step: float) -> None:
    other = put(box(0.1, 0.1, 0.05), (0.2, 0, -0.05 + step))
    assert margin(can(0.06), SLAB, around=[other]) == pytest.approx(0.01, abs=0.1 * MM)


def wedge(length: float, half: float, height: float) -> BodyShape:
    """A slope down from x = 0, ``height`` above the floor, to the floor at x = ``length``."""
    corners = [(0, y, 0) for y in (-half, half)] + [(length, y, 0) for y in (-half, half)]
    mesh = Mesh.build(np.array([*corners, (0, -half, height), (0, half, height)]))
    return shape(Geom(kind="convex_mesh", mesh=mesh.key), meshes={mesh.key: mesh}, name="wedge")


def test_on_a_wedge_the_foot_is_no_edge_and_a_side_is_one_from_where_it_is_high() -> None:
    """1 m long, 40 cm wide, 20 cm high; a plate 10 × 10 cm lies flat on it, its middle at x."""
    slope, table = np.arctan(0.2), put(box(2, 2, 0.01), (0, 0, -0.01))
    ramp = put(wedge(1.0, 0.2, 0.2), (0, 0, 0))
    turn = (np.cos(slope / 2), 0, np.sin(slope / 2), 0)
    up = np.array([np.sin(slope), 0, np.cos(slope)])
    half = 0.05 * np.cos(slope)  # of the plate, seen from above

    def plate(x: float, y: float) -> Mover:
        return put(box(0.05, 0.05, 0.004), np.array([x, y, 0.2 - 0.2 * x]) + 0.004 * up, turn)

    lean = 0.001 * np.sin(slope) * np.cos(slope)  # of the base, 1 mm above the slope
    for around in ((), (table,)):
        top = margin(plate(0.1, 0), ramp, around=around)
        assert top == pytest.approx(0.1 - half, abs=0.1 * MM)
        assert margin(plate(0.4, 0.1), ramp, around=around) == pytest.approx(0.05, abs=0.1 * MM)
    assert margin(plate(0.93, 0), ramp) == pytest.approx(1 - 0.93 - half - lean, abs=0.1 * MM)
    to_side = np.hypot(0.93 - half - 0.9, 0.15)  # the side is 2 cm high at x = 0.9
    assert margin(plate(0.93, 0), ramp, around=[table]) == pytest.approx(to_side, abs=2 * MM)


def scene(rng: np.random.Generator) -> tuple[Mover, list[Mover]]:
    """A can on the first of some slabs that meet at several heights; rails, and things about."""
    steps = np.cumsum([0.0, *rng.choice([0, 0.001, -0.004, -0.012, -0.03, 0.006], 2)])
    around = [
        put(box(0.1, 0.1, 0.02), (0.2 * i + rng.choice([0, 0.003, 0.008]) * i, 0, z - 0.02))
        for i, z in enumerate(steps)
    ]
    around.append(put(box(0.1, 0.004, 0.02), (rng.uniform(-0.1, 0.3), 0.105, 0.01)))
    around.append(put(box(0.5, 0.5, 0.01), (0, 0, -0.05)))
    return can(*rng.uniform(-0.09, 0.12, 2)), around


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, deadline=None, max_examples=40)
def test_more_is_an_edge_the_smaller_the_step_and_what_is_far_away_changes_nothing(
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    a, (under, *others) = scene(rng)
    found = [margin(a, under, around=others, drop=d) for d in (0.002, 0.005, 0.01, 0.02, 0.04)]
    assert all(x <= y + 1e-9 for x, y in pairwise(found))
    far = put(box(0.1, 0.1, 0.3), (*rng.choice([-5, 5], 2), rng.uniform(-0.3, 0.3)))
    assert margin(a, under, around=[*others, far]) == pytest.approx(found[3], abs=1e-9)
