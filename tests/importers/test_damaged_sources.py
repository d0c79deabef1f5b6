"""Whatever is wrong with a foreign file is reported in words, and never becomes a trace that is broken."""

import h5py
import numpy as np
import pytest
from exports import map_text, write_maniskill, write_robolab
from scenes import Scene

from safestage_eval.episode import Body
from safestage_eval.formats import validate
from safestage_eval.importers import Settings, import_all, load_map
from safestage_eval.importers.hdf5 import datasets

DAMAGES = ("gone", "short", "narrow", "nan", "text", "flat")
"""An actor that is gone is simply not there; any other damage is reported."""


def scene():
    s = (
        Scene(8, 20.0)
        .fixed("table")
        .box("cube", 0.02, np.linspace((0, 0, 0.02), (0.1, 0, 0.02), 8))
    )
    s.bodies.append(Body(name="hand", kind="gripper"))
    s.tracks["hand"] = s.tracks["cube"]
    return s.episode(success=False, task="Push")


def source_of(layout, folder):
    if layout == "robolab":
        return write_robolab(folder, [scene()])
    return write_maniskill(folder, scene())


def damaged(path, name, damage):
    """False where the damage does not apply."""
    with h5py.File(path, "a") as file:
        data = file[name]
        values = data[()]
        if (damage == "narrow" and values.ndim < 2) or (
            damage == "nan" and values.dtype.kind != "f"
        ):
            return False
        del file[name]
        if damage == "short":
            file[name] = values[: len(values) // 2]
        elif damage == "narrow":
            file[name] = values[:, :-1]
        elif damage == "nan":
            file[name] = np.full_like(values, np.nan)
        elif damage == "text":
            file[name] = "none"
        elif damage == "flat":
            file[name] = np.float32(1)
    return True


def names_of(layout, folder):
    with h5py.File(source_of(layout, folder)) as file:
        return [name for name, _ in datasets(file)]


@pytest.mark.parametrize("layout", ["robolab", "maniskill"])
@pytest.mark.parametrize(
    "damage",
    [d if d in ("short", "nan") else pytest.param(d, marks=pytest.mark.slow) for d in DAMAGES],
)
def test_every_dataset_damaged_in_turn(tmp_path, layout, damage):
    (tmp_path / "map.toml").write_text(map_text(scene()))
    settings = Settings(map=load_map(tmp_path / "map.toml"))
    refused = 0
    for i, name in enumerate(names_of(layout, tmp_path / "whole")):
        source = source_of(layout, tmp_path / str(i))
        if not damaged(source, name, damage):
            continue
        target = tmp_path / f"data{i}"
        outcome = import_all(source, target, settings)
        assert len(outcome.imported) + len(outcome.failed) == 1
        for problem in outcome.failed:
            refused += 1
            assert "bug in the" not in problem.message, (name, problem.message)
        if outcome.imported:
            assert validate(target) == [], name
    assert refused > (2 if layout == "robolab" else -1 if damage == "gone" else 1)
