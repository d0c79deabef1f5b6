"""Contacts that are kept packed are the same table as the one that is built from them."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.episode import Body, ContactTable, Geom, Header
from safestage_eval.errors import TraceError
from safestage_eval.formats.contact_points import POINT, GeomNames, PackedContacts, contact_table
from safestage_eval.formats.mcap.mcap_reader import read_contacts

BALL = Geom(kind="sphere", size=(0.1,))
NAMES = GeomNames(
    Header(
        episode_id="e",
        physics_dt=0.01,
        frame_dt=0.01,
        bodies=tuple(
            Body(name=name, kind="object", geoms=(BALL,) * geoms)
            for name, geoms in (("a", 2), ("b", 1), ("c", 3), ("d", 0), ("e", 1))
        ),
    )
)


@st.composite
def clouds(draw, ordered):
    """Points of some frames; ordered: as the canonical table has them."""
    geoms = len(NAMES.owner)
    pairs = [(i, j) for i in range(geoms) for j in range(geoms) if NAMES.owner[i] < NAMES.owner[j]]
    pairs.sort(key=lambda p: (*NAMES.owner[list(p)], *p))
    some = st.lists(st.sampled_from(pairs), max_size=6)
    frames = draw(st.lists(some, max_size=6))
    if ordered:
        frames = [sorted(rows, key=pairs.index) for rows in frames]
    else:
        turned = st.booleans()
        frames = [[p[::-1] if draw(turned) else p for p in rows] for rows in frames]
    counts = np.array([len(rows) for rows in frames], np.int64)
    points = np.zeros(counts.sum(), POINT)
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    for name in ("position", "normal", "force", "peak_force", "depth"):
        points[name] = rng.normal(size=points[name].shape)
    rows = [pair for some in frames for pair in some]
    points["geom1"], points["geom2"] = zip(*rows, strict=True) if rows else ((), ())
    return points, counts


def built(points, counts):
    """The table that is built from the points column by column."""
    body1, body2 = NAMES.bodies(points)
    columns = {name: points[name] for name in points.dtype.names}
    frame = np.repeat(np.arange(len(counts)), counts)
    return ContactTable.build(frame=frame, body1=body1, body2=body2, **columns)


def same(given, expected):
    for f in fields(ContactTable):
        one, other = getattr(given, f.name), getattr(expected, f.name)
        assert one.dtype == other.dtype
        assert one.tobytes() == other.tobytes(), f.name
    assert given.pairs == expected.pairs
    for pair in [*expected.pairs, (0, 4), (3, 4)]:
        assert given.rows(pair).tolist() == expected.rows(pair).tolist()
        names = [f.name for f in fields(ContactTable)] + ["force.z", "position.x"]
        both = zip(given.of_pair(pair, *names), expected.of_pair(pair, *names), strict=True)
        assert all(one.tolist() == other.tolist() for one, other in both)


@given(clouds(ordered=True))
def test_points_in_order_stay_packed(cloud):
    contacts = contact_table(*cloud, NAMES)
    assert isinstance(contacts, PackedContacts)
    same(contacts, built(*cloud))


@given(clouds(ordered=False))
def test_points_in_any_order_are_sorted(cloud):
    same(contact_table(*cloud, NAMES), built(*cloud))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("force", np.inf, "contact force is not a finite number at row 1"),
        ("depth", np.inf, "contact depth is not a finite number at row 1"),
        ("geom2", 7, "geom2 is 7; there are 7 geoms"),
        ("geom1", 65535, "geom1 is 65535; there are 7 geoms"),
    ],
)
def test_broken_points_are_refused(name, value, message):
    points = np.zeros(3, POINT)
    points["geom2"] = 2
    points[name][1] = value
    with pytest.raises(TraceError, match=message):
        read_contacts(points, np.array([1, 2]), NAMES, "x", checked=True)


def test_a_geom_number_that_reads_as_no_number_is_no_broken_value():
    """Two geoms may look like a NaN where all bytes of a point are taken for numbers."""
    bodies = (
        Body(name="floor", kind="fixture", geoms=(BALL,)),
        Body(name="pile", kind="object", geoms=(BALL,) * 0x7F90),
    )
    names = GeomNames(Header(episode_id="e", physics_dt=0.01, frame_dt=0.01, bodies=bodies))
    points = np.zeros(1, POINT)
    points["geom2"] = 0x7F80
    points["geom1"] = 0
    with np.errstate(invalid="ignore"):
        assert not np.isfinite(points.view("<f4")).all()
    contacts = read_contacts(points, np.array([1]), names, "x", checked=True)
    assert contacts.geom2.tolist() == [0x7F80]
