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
