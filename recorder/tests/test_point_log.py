"""Contacts listed as points: the peaks of the steps between frames, and pairs that touched there only."""

import numpy as np

from safestage_record.mesh_files import read_hulls
from safestage_record.point_log import PointLog

BODIES = [0, 1, 1, 2]
"""Shapes 1 and 2 are of one body."""


def rows(*touches):
    """Contacts of (geom, geom, normal force), all along z."""
    return [
        (
            frozenset((BODIES[first], BODIES[second])),
            n,
            ((0, 0, 0), (0, 0, 1), (0, 0, n), n, 0.001, first, second),
        )
        for first, second, n in touches
    ]


def test_a_pairs_peak_is_the_largest_sum_of_a_step_since_the_frame_before():
    log = PointLog()
    log.take(rows((0, 1, 2.0), (2, 0, 3.0)))  # the pair of bodies 0 and 1: 5 N together
    log.take(rows((0, 1, 4.0), (0, 3, 7.0)))
    log.end_frame(rows((0, 1, 1.0), (0, 2, 0.5)))
    log.end_frame(rows((0, 1, 1.0)))
    log.end_frame(rows())
    points, counts = log.finish()
    assert counts.tolist() == [3, 1, 0]
    assert points["peak_force"].tolist() == [5.0, 5.0, 7.0, 1.0]
    assert points["force"][:, 2].tolist() == [1.0, 0.5, 0.0, 1.0]
    assert (points["geom1"][2], points["geom2"][2]) == (0, 3)
    assert len(log.finish()[0]) == 0


def test_contacts_of_what_the_trace_lacks_are_counted_and_left_out():
    log = PointLog()
    unknown = [(None, 3.0, None)]
    log.take(unknown + rows((0, 1, 2.0)))
    log.end_frame(rows((0, 3, 1.0)) + unknown * 2)
    points, counts = log.finish()
    assert log.unrecorded == 3
    assert counts.tolist() == [2]
    assert points["peak_force"].tolist() == [1.0, 2.0]


def test_each_part_of_a_decomposed_mesh_is_a_hull_of_its_own(tmp_path):
    path = tmp_path / "two.obj"
    path.write_text(
        "o first\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1/1/1 2/2/2 4/3/3\n"
        "o second\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3 -2 -1\n"
    )
    first, second = read_hulls(path)
    assert first.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert second[:, 0].tolist() == [5, 6, 5]
    corners = np.array(
        [[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [1, 0, 0], [0, 0, 1]]], "<f4"
    )
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("about", "<u2")])
    triangles = np.zeros(2, kind)
    triangles["corners"] = corners
    path = tmp_path / "binary.stl"
    path.write_bytes(b"solid".ljust(80) + np.array([2], "<u4").tobytes() + triangles.tobytes())
    [points] = read_hulls(path)
    assert sorted(points.tolist()) == sorted([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    path = tmp_path / "text.stl"
    lines = "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners.reshape(-1, 3))
    path.write_text(f"solid\nfacet normal 0 0 1\nouter loop\n{lines}endloop\nendfacet\nendsolid\n")
    assert len(read_hulls(path)[0]) == 4
    assert read_hulls(tmp_path / "other.dae") == []
