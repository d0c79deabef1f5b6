"""PyBullet's contacts: which touch, whose they are, and the force on the second body."""

import numpy as np
import pytest

from safestage_record.bullet_touches import BulletTouches, read_touches


def contact(a, b, link, other, apart, size, push=0.0, pull=0.0):
    """A contact as getContactPoints lists it, normal along z, friction along x and y."""
    return (
        0, a, b, link, other, (0.1, 0.2, 0.3), (0.1, 0.2, 0.29), (0.0, 0.0, 1.0), apart, size,
        push, (1.0, 0.0, 0.0), pull, (0.0, 1.0, 0.0),
    )  # fmt: skip


@pytest.fixture
def touches():
    made = BulletTouches()
    made.first.update({(0, -1): 0, (1, -1): 1, (1, 3): 4})
    return made


def test_what_is_apart_without_a_force_does_not_touch(touches):
    found = touches.rows(
        [contact(0, 1, -1, -1, a, n) for a, n in ((0.01, 0), (0.01, 2), (-0.01, 0))]
    )
    assert [size for _, size, _ in found] == [2, 0]


def test_a_pair_is_the_same_in_either_order_and_links_are_bodies_of_their_own(touches):
    rows = [contact(0, 1, -1, 3, 0, 1), contact(1, 0, 3, -1, 0, 1), contact(0, 1, -1, -1, 0, 1)]
    first, second, third = [pair for pair, _, _ in touches.rows(rows)]
    assert first == second != third


def test_what_came_later_is_no_pair(touches):
    assert [pair for pair, _, _ in touches.rows([contact(0, 7, -1, -1, 0, 1)])] == [None]


def test_the_force_is_the_one_on_the_second_body_with_friction(touches):
    block = touches.pack(contact(0, 1, -1, 3, -0.002, 5.0, 0.5, -0.25))
    [point] = read_touches(block)
    assert point["force"].tolist() == [-0.5, 0.25, -5.0]
    assert point["normal"].tolist() == [0, 0, -1]
    assert point["position"] == pytest.approx([0.1, 0.2, 0.3])
    assert point["depth"] == np.float32(0.002)
    assert (point["geom1"], point["geom2"]) == (0, 4)
