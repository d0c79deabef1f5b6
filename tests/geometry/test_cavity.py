"""Containment in the container's own frame."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import box, put, shape, sphere
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.episode import Cavity, Geom
from safestage_eval.geometry import pose
from safestage_eval.geometry.cavity import containment_depth, inside_parts

BIN = Cavity(kind="box", size=(0.1, 0.08, 0.05), position=(0, 0, 0.05))
MUG = Cavity(kind="cylinder", size=(0.04, 0.05), position=(0, 0, 0.05))
HOLLOW = shape()
AT_ORIGIN = put(HOLLOW, (0, 0, 0))


def test_depth_is_to_the_nearest_wall_floor_or_rim() -> None:
    places = np.array(
        [[0, 0, 0.03], [0.09, 0, 0.05], [0, 0, 0.09], [0, 0, 0.3], [0.13, 0.12, 0.05]]
    )
    ball = put(sphere(0.01), places, np.tile([1.0, 0, 0, 0], (5, 1)))
    depth = containment_depth(ball, AT_ORIGIN, BIN)
    np.testing.assert_allclose(depth, [0.03, 0.01, 0.01, -0.2, -0.05], atol=1e-12)
    np.testing.assert_allclose(
        containment_depth(ball, AT_ORIGIN, MUG)[[0, 1, 2]], [0.03, -0.05, 0.01], atol=1e-12
    )


def test_spoon_in_a_mug_and_fruit_over_a_bin() -> None:
    spoon = shape(Geom(kind="capsule", size=(0.005, 0.09)))
    leaning = put(spoon, (0.012, 0, 0.102), pose.unit([1, 0, 0.1, 0]))
    low, centre = inside_parts(leaning, AT_ORIGIN, MUG)
    assert low[0]
    assert not centre[0]
    hovering = put(sphere(0.03), (0, 0, 0.4))
    assert not any(part[0] for part in inside_parts(hovering, AT_ORIGIN, BIN))
    lying = put(sphere(0.03), (0, 0, 0.03))
    assert all(part[0] for part in inside_parts(lying, AT_ORIGIN, BIN))


def test_across_the_rim_and_under_the_floor_is_not_inside() -> None:
    """Contacts overlap by a little: the book sinks 0.5 mm into the rim, the block into the floor."""
    book = put(box(0.09, 0.03, 0.01), (0.06, 0, 0.1095))
    assert not inside_parts(book, AT_ORIGIN, BIN)[0][0]
    block = put(box(0.03, 0.03, 0.03), (0, 0, -0.03 + 0.0005))
    assert not inside_parts(block, AT_ORIGIN, BIN)[0][0]
    resting = put(box(0.03, 0.03, 0.03), (0, 0, 0.03 - 0.0005))
    assert inside_parts(resting, AT_ORIGIN, BIN)[0][0]
    outside = put(box(0.03, 0.03, 0.03), (0.15, 0, 0.03))
    assert not inside_parts(outside, AT_ORIGIN, BIN)[0][0]


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, deadline=None, max_examples=20)
def test_tilting_and_carrying_the_container_with_its_content_changes_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 12
    p, q = (
        rng.uniform(-0.12, 0.12, (n, 3)) + np.array([0, 0, 0.05]),
        pose.unit(rng.normal(size=(n, 4))),
    )
    egg = shape(Geom(kind="ellipsoid", size=(0.01, 0.02, 0.03)))
    shift, turn = rng.normal(size=3), pose.unit(rng.normal(size=4))
    carried = put(egg, *pose.compose(shift, turn, p, q))
    for cavity in (BIN, MUG):
        here = put(egg, p, q)
        there = put(HOLLOW, shift, turn)
        np.testing.assert_allclose(
            containment_depth(here, AT_ORIGIN, cavity),
            containment_depth(carried, there, cavity),
            atol=1e-12,
        )
        for one, other in zip(
            inside_parts(here, AT_ORIGIN, cavity), inside_parts(carried, there, cavity), strict=True
        ):
            np.testing.assert_array_equal(one, other)


def test_a_plane_has_no_centroid() -> None:
    with pytest.raises(ValueError, match="no hull"):
        containment_depth(put(Geom(kind="plane"), (0, 0, 0)), AT_ORIGIN, BIN)
