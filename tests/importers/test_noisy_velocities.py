"""Noisy velocities give way to smooth poses; other mistakes of velocities are left for the audit to name."""

import numpy as np
import pytest
from exports import write_robolab
from scenes import Scene
from studio import run

from safestage_eval.episode import Track
from safestage_eval.formats import load
from safestage_eval.importers.noisy_velocities import is_noisy

T = np.arange(60) / 30


def track(velocity, path):
    still = np.tile([1.0, 0, 0, 0], (len(T), 1))
    return Track(*(np.asarray(a, np.float32) for a in (path, still, velocity, 0 * path)))


def motion(kind):
    """Positions and true velocities of a body at rest, carried along an arc, or falling."""
    x, v = np.zeros((len(T), 3)), np.zeros((len(T), 3))
    if kind == "carried":
        x[:, 0], v[:, 0] = 0.2 * np.sin(T), 0.2 * np.cos(T)
    elif kind == "falling":
        fall = np.minimum(T, 0.3)
        x[:, 2], v[:, 2] = -4.905 * fall**2, np.where(T < 0.3, -9.81 * T, 0)
    return x, v


@pytest.mark.parametrize("kind", ["at rest", "carried", "falling"])
def test_only_noise_is_doubted(kind):
    x, v = motion(kind)
    shaken = v + np.random.default_rng(1).normal(0, 0.5, v.shape)
    assert not is_noisy(T, track(v, x))
    assert is_noisy(T, track(shaken, x)) == (kind != "falling")
    for wrong in (100 * v, 0.01 * v, -v, v[:, [1, 2, 0]], np.roll(v, 2, axis=0)):
        assert not is_noisy(T, track(wrong, x)), "no noise, but a mistake that the audit names"


@pytest.mark.parametrize("stated", [None, "recorded", "from poses"])
def test_an_import_says_whose_velocities_it_took(tmp_path, stated):
    scene = Scene(40, 20.0).fixed("table", (0, 0, 0.4)).box("cube", 0.02, (0, 0, 0.42))
    scene.tracks["cube"].linear_velocity[:] += np.random.default_rng(2).normal(0, 0.3, (40, 3))
    source = write_robolab(tmp_path / "in", [scene.episode(task="A")])
    line = "" if stated is None else f'velocities = "{stated}"\n'
    (tmp_path / "map.toml").write_text(f"[source]\n{line}")
    done = run("import", source, "--to", tmp_path / "data", "--map", tmp_path / "map.toml")
    assert done.code == 0, done.err
    kept = stated == "recorded"
    assert load(tmp_path / "data").track("cube").linear_velocity.any() == kept
    assert ("velocities of cube" in done.text) == (not kept)
