"""Goals of bind files are the benchmarks' own: a recorded success that they deny is listed, and the other way round."""

import json

import numpy as np
import pytest
from scenes import Scene
from studio import run

from safestage_eval.formats import save

N, RATE = 120, 20.0


def carried(kind, names, rise, *, on=False):
    """A cube goes up by ``rise`` m within 2 s and stays there; ``on``: on top of another, and moved over it."""
    s = Scene(N, RATE).fixed("table", (0, 0, 0.8 if kind == "robosuite" else 0.0))
    half = 0.02
    ground = (0.8 if kind == "robosuite" else 0.0) + half
    up = np.clip(s.t / 2, 0, 1)[:, None]
    if len(names) > 1:
        s.box(names[1], half, (0.2, 0, ground))
    over = (0.2 if on else 0.0, 0, rise)
    s.box(names[0], half, np.array([0, 0, ground]) + up * over)
    return s


CASES = [
    ("robosuite", "Lift", ("cube_main",), 0.05, False, True),
    ("robosuite", "Lift", ("cube_main",), 0.015, False, False),
    ("maniskill", "StackCube-v1", ("cubeA", "cubeB"), 0.04, True, True),
    ("maniskill", "StackCube-v1", ("cubeA", "cubeB"), 0.04, False, False),
    ("maniskill", "StackCube-v1", ("cubeA", "cubeB"), 0.05, True, False),
]


@pytest.mark.parametrize(("kind", "task", "names", "rise", "on", "reached"), CASES)
@pytest.mark.parametrize("recorded", [True, False])
def test_recorded_against_recomputed(tmp_path, kind, task, names, rise, on, reached, recorded):
    scene = carried(kind, names, rise, on=on)
    said = {"success": True, "success_time": float(scene.t[-1])} if recorded else {"success": False}
    save(scene.episode(task=task, **said), tmp_path / "e.mcap")
    done = run("audit", tmp_path / "e.mcap", "--bind", kind, "--format", "json")
    found = [each for each in json.loads(done.text)["findings"] if each["code"] == "AUD314"]
    never = "the goal is never reached" in json.dumps(found)
    missed = "recorded as no success, but" in json.dumps(found)
    assert (never, missed) == (recorded and not reached, reached and not recorded)


EDGE = 0.0468
"""m, of Isaac Lab's cubes."""


def cubes_stacked(one, two, three):
    """Isaac Lab's own condition (stack/mdp/terminations.py) on the places of three cubes, but for the gripper."""
    pairs = [(one, two), (two, three)]
    beside = all(np.hypot(*(low - high)[:2]) < 0.04 for low, high in pairs)
    near = all(abs(high[2] - low[2]) - EDGE < 0.005 for low, high in pairs)
    return beside and near and one[2] < two[2] < three[2]


@pytest.mark.parametrize("aside", [0.0, 0.035, 0.045])
@pytest.mark.parametrize("gap", [0.0, 0.004, 0.007])
@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2)])
def test_isaac_labs_tower_is_its_own(tmp_path, aside, gap, order):
    s = Scene(N, RATE).fixed("table", (0, 0, 0))
    end = [
        np.array([0, aside * (n == 2), EDGE / 2 + (EDGE + gap * (n == 2)) * n]) for n in range(3)
    ]
    up = np.clip(s.t / 2, 0, 1)[:, None]
    for i, n in enumerate(order):
        begin = np.array([0.2 * (n - 1), 0.3 * (n > 0), EDGE / 2])
        s.box(f"cube_{i + 1}", EDGE / 2, begin + up * (end[n] - begin))
    episode = s.episode(
        task="Isaac-Stack-Cube-Franka-v0", success=True, success_time=float(s.t[-1])
    )
    save(episode, tmp_path / "e.mcap")
    done = run("audit", tmp_path / "e.mcap", "--bind", "isaaclab", "--format", "json")
    found = [each for each in json.loads(done.text)["findings"] if each["code"] == "AUD314"]
    never = "the goal is never reached" in json.dumps(found)
    assert never != cubes_stacked(*(end[n] for n in order))
