"""Recorders of simulators that list contacts: what they look at between two frames."""

import numpy as np
import pytest
from zip_arrays import read

from safestage_record.point_log import pack_point, read_points
from safestage_record.point_recorder import PointRecorder
from safestage_record.scene_parts import describe_body, describe_geom


class Falling(PointRecorder):
    """A ball that hits the floor in the second of each ten physics steps."""

    def __init__(self, path, looks):
        names = ["floor", "ball"]
        super().__init__(path, names, None, {})
        self._physics_dt, self._joints = 0.002, []
        self._stands = np.zeros((1, 3)), np.eye(4)[:1]
        self._bodies = [
            describe_body(name, kind, kind == "object", [describe_geom("sphere", [0.1])], mass=1.0)
            for name, kind in zip(names, ("fixture", "object"))
        ]
        self._looks, self.looked = looks, 0
        self._take_frame()

    def _take_frame(self):
        self._keep_points(self._seen)

    def _points(self, known=()):
        self.looked += 1
        touch = ((0, 0, 0), (0, 0, 1), (0, 0, 5.0), 5.0, 0.001, 0, 1)
        return [("ball on floor", touch[3], touch)] if self._seen % 10 == 2 else []

    def _pack_point(self, point):
        return pack_point(point)

    def _read_points(self, block):
        return read_points(block)

    def _columns(self, frames):
        count = len(frames)
        place = np.zeros((count, 1, 3))
        place[:, 0, 2] = frames
        return {
            "position": place, "orientation": np.tile(np.eye(4)[0], (count, 1, 1)),
            "linear_velocity": place, "angular_velocity": place,
            **{f"joint_{name}": np.zeros((count, 0)) for name in ("position", "velocity", "torque")},
            "gripper": np.zeros((count, 0)),
        }  # fmt: skip


@pytest.mark.parametrize("looks", [True, False])
def test_frames_alone_are_of_the_same_moments_and_know_nothing_between_them(tmp_path, looks):
    with Falling(tmp_path / "t.zip", looks) as recorder:
        for _ in range(6):
            for _ in range(10):
                recorder.after_step()
            recorder.step([0.0])
    header, arrays = read(tmp_path / "t.zip")
    assert arrays["t"].tolist() == pytest.approx([0.02 * k for k in range(7)])
    assert arrays["position"][0, :, 2].tolist() == [10 * k for k in range(7)]
    assert recorder.looked == (6 * 11 if looks else 6)
    assert arrays["contacts"]["peak_force"].tolist() == ([5.0] * 6 if looks else [])
    said = [remark["what"] for remark in header["source"]["account"]]
    assert ("contacts and forces between frames" in said) != looks
