"""A film holds what the trace holds, to a fraction of a millimetre, and nothing that was judged."""

import json
import struct

import numpy as np
import pytest
from scenes import Scene
from scipy.spatial.transform import Rotation

from safestage_eval.episode import Geom
from safestage_eval.viewer.film import film


def unpack(data):
    """Header, and body → (N, 7) position and w x y z: as the file's description says."""
    (length,) = struct.unpack_from("<I", data)
    head, rest = json.loads(data[4 : 4 + length]), data[4 + length :]
    poses = {}
    for body in head["bodies"]:
        if "pose" in body:
            poses[body["name"]] = np.array([body["pose"]])
            continue
        n = head["frames"]
        steps = np.frombuffer(rest, "<u2", 7 * n, body["track"]).reshape(7, n).astype(np.int64)
        columns = np.cumsum(steps, axis=1) % 65536
        position = np.array(body["low"])[:, None] + body["step"] * columns[:3]
        turn = np.where(columns[3:] > 32767, columns[3:] - 65536, columns[3:]) / 32767
        poses[body["name"]] = np.concatenate([position, turn]).T
    return head, np.frombuffer(rest, "<f4", head["frames"], head["times"]), poses, rest


def spinning(frames=241, rate=120.0):
    t = np.arange(frames) / rate
    turn = Rotation.from_rotvec(np.outer(4 * t, [0.3, -0.5, 0.8])).as_quat()[:, [3, 0, 1, 2]]
    turn[::7] *= -1  # the same orientation, written the other way
    path = np.stack([0.4 * t, np.sin(3 * t), 0.2 + 0 * t], -1)
    cube = Geom(kind="box", size=(0.02, 0.03, 0.04))
    scene = Scene(frames, rate).fixed("table").body("cube", cube, path, turn)
    return scene.box("lies", 0.05, (1, 2, 0.05)), t, path, turn


def test_poses_are_the_traces_own():
    scene, t, path, turn = spinning()
    head, times, poses, _ = unpack(film(scene.episode()))
    rows = np.searchsorted(t, times.astype(float) - 1e-6)
    assert times == pytest.approx(t[rows], abs=1e-6)
    assert poses["cube"][:, :3] == pytest.approx(path[rows], abs=3e-5)
    there = Rotation.from_quat(turn[rows][:, [1, 2, 3, 0]])
    found = Rotation.from_quat(poses["cube"][:, [4, 5, 6, 3]])
    assert (there.inv() * found).magnitude().max() < 1e-4
    assert (np.einsum("ij,ij->i", poses["cube"][1:, 3:], poses["cube"][:-1, 3:]) > 0).all()
    assert poses["table"].tolist() == [[0, 0, 0, 1, 0, 0, 0]]
    assert poses["lies"] == pytest.approx(np.array([[1, 2, 0.05, 1, 0, 0, 0]]))
    assert [body["kind"] for body in head["bodies"]] == ["fixture", "object", "object"]


@pytest.mark.parametrize(("frames", "rate"), [(1, 120), (2, 120), (50, 10), (1000, 240)])
def test_the_beat_is_even_and_both_ends_are_there(frames, rate):
    episode = Scene(frames, rate).box("a", 0.05, (0, 0, 0.05)).episode()
    _, times, _, _ = unpack(film(episode))
    assert times[0] == 0
    assert times[-1] == pytest.approx(episode.t[-1])
    gaps = np.diff(times)
    assert (gaps > 0).all()
    assert gaps.max(initial=0) <= max(1 / 15 + 1 / rate, 1 / rate) + 1e-6
    assert len(times) <= np.ceil(15 * episode.t[-1]) + 2


def test_roles_are_shown_and_policies_are_not():
    scene, *_ = spinning()
    episode = scene.episode(
        episode_id="SECRET-1", policy="SECRET-2", notes=("SECRET-3",), rules=("ETS101",),
        roles={"target": ("cube",), "protected": ("cube", "lies")}, success_time=1.25,
    )  # fmt: skip
    data = film(episode)
    head, *_ = unpack(data)
    assert head["bodies"][1]["roles"] == ["target", "protected"]
    assert head["success"] == 1.25
    assert b"SECRET" not in data
    assert b"ETS101" not in data
