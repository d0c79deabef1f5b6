"""LeRobot v2 and v3 through a column map, and what is refused."""

import json

import numpy as np
import pytest
from exports import map_text, write_lerobot
from scenes import Scene
from studio import run

from safestage_eval.formats import discover, load


def scene(number=0):
    s = Scene(20, 10.0).fixed("table")
    path = np.linspace((0, 0, 0.02), (0.3, 0.1 * number, 0.02), 20)
    return s.box("cube", 0.02, path).episode(success=True, success_time=1.0)


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_both_versions(tmp_path, version):
    ours = [scene(i) for i in range(3)]
    source, columns = write_lerobot(tmp_path / "in", ours, version)
    (tmp_path / "map.toml").write_text(map_text(ours[0], success=True) + columns)
    done = run("import", source, "--to", tmp_path / "data", "--map", tmp_path / "map.toml")
    assert done.code == 0, done.err
    assert len(discover(tmp_path / "data")) == 3
    for number, episode in enumerate(ours):
        theirs = load(tmp_path / "data", f"in/episode_{number}")
        assert np.array_equal(theirs.track("cube").position, episode.track("cube").position)
        assert np.allclose(theirs.t, episode.t, atol=1e-6)
        assert theirs.header.instruction == "do it"
        assert theirs.header.rollout == number
        assert theirs.frames.action.shape == (20, 0)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda text: "", ("observation.environment_state", "[columns.body.NAME]")),
        (lambda text: text.replace('quaternion = "xyzw"', ""), ("prescribes none", "--quaternion")),
        (lambda text: text.replace("[3:7]", "[3:6]"), ("has 3 numbers in a row. Allowed: 4",)),
        (lambda text: text.replace("twists", "speeds"), ("'observation.speeds'", "no column")),
        (
            lambda text: text.split("[columns", 1)[1].join(["[columns", ""]),
            ("no object has a shape",),
        ),
    ],
)
def test_what_the_map_lacks(tmp_path, change, told):
    source, columns = write_lerobot(tmp_path / "in", [scene()])
    (tmp_path / "map.toml").write_text(change(map_text(scene()) + columns))
    done = run("import", source, "--to", tmp_path / "data", "--map", tmp_path / "map.toml")
    assert done.code == 2
    for part in told:
        assert part in done.err
    assert "Traceback" not in done.err


def described(path, features, **more):
    (path / "meta").mkdir(parents=True)
    info = {
        "codebase_version": "v2.1",
        "fps": 15,
        "features": {key: {} for key in features},
        **more,
    }
    (path / "meta/info.json").write_text(json.dumps(info))
    return path


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("droid_100", "never measured"),
        ("libero_spatial_no_noops", "data/demo_i/states"),
        ("robocasa_mg", "states.npz"),
        ("my_robot", "object tracker"),
    ],
)
def test_conversions_that_dropped_the_objects(tmp_path, name, told):
    source = described(tmp_path / name, ["observation.state", "action", "observation.images.top"])
    done = run("import", source, "--to", tmp_path / "data")
    assert done.code == 2
    assert "has no poses of objects" in done.err
    assert "observation.state, action" in done.err
    assert told in done.err
    assert not (tmp_path / "data").exists()
