"""``safestage import`` for any format: finding, resuming, refusing, reporting."""

import json

import numpy as np
import pytest
import trimesh
from studio import run
from toy_importer import Toy

from safestage_eval.formats import discover, load, validate
from safestage_eval.importers import importer, registry
from safestage_eval.importers.read_source import Here

MAP = """
[every]
policy = "by hand"
roles = { target = "cube" }

[episode.b]
success = true
success_time = "20 ms"

[body.cube]
mass = 0.2
up = [0, 0, 2]
tags = "fragile"
shapes = [{ kind = "box", size = ["3 cm", "3 cm", 0.03] }]

[body.table]
position = [0, 0, "-2 cm"]
shapes = [{ kind = "box", size = [0.5, 0.5, 0.02] }]
"""


@pytest.fixture(autouse=True)
def toys(monkeypatch):
    monkeypatch.setattr(registry, "importer", lambda name: Toy)
    monkeypatch.setattr("safestage_eval.importers.read_source.importer", lambda name: Toy)
    monkeypatch.setattr(  # no other process knows toys
        "safestage_eval.importers.import_source.Apart", lambda target, limits, jobs: Here(target)
    )
    monkeypatch.setattr(registry, "OWN", {"toy": "toy"})
    monkeypatch.setattr(registry, "FROM_SIMULATE", ())


@pytest.fixture
def source(tmp_path):
    path = tmp_path / "in" / "toys.json"
    path.parent.mkdir()
    path.write_text(json.dumps({"toy": {"a": {"cube": [0.03, 0.04]}, "b": {"cube": [1, 2, 3]}}}))
    (tmp_path / "map.toml").write_text(MAP)
    return path


def take(source, to, *more):
    return run("import", source, "--to", to, "--map", to.parent / "map.toml", *more)


def test_a_source_becomes_a_dataset(source, tmp_path):
    done = take(source, tmp_path / "data", "--dt", "1/100")
    assert done.code == 0, done.err
    assert validate(tmp_path / "data") == []
    episode = load(tmp_path / "data", "toys/b")
    assert episode.track("cube").position[:, 2].tolist() == [1, 2, 3]
    assert np.allclose(episode.t, [0, 0.01, 0.02])
    cube, table = episode.bodies["cube"], episode.bodies["table"]
    assert (cube.mass, cube.up_axis, cube.tags) == (0.2, (0, 0, 1), ("fragile",))
    assert cube.geoms[0].size == pytest.approx((0.03,) * 3)
    assert not table.movable
    assert episode.tracks["table"].position[0, 2] == np.float32(-0.02)
    header = episode.header
    assert (header.policy, header.success, header.success_time) == ("by hand", True, 0.02)
    assert load(tmp_path / "data", "toys/a").header.success is None
    assert header.source.episode == "toys.json:b"
    assert sorted((r.kind, r.what) for r in header.source.account) == [
        ("guessed", "centres of mass"),
        ("guessed", "orientations"),
        ("guessed", "velocities"),
        ("missing", "contacts and their forces"),
        ("missing", "insides of containers"),
        ("missing", "success"),
    ]
    assert "2 of 2  missing: contacts and their forces" in done.text
    assert (
        "remedy: none: they were not recorded"
        in run("explain", "scene", tmp_path / "data", "toys/b").text
    )


def test_importing_again_imports_nothing(source, tmp_path):
    first = take(source, tmp_path / "data", "--dt", "0.01", "--limit", "1")
    assert "1 imported, 0 there already" in first.err
    second = take(source, tmp_path / "data", "--dt", "0.01")
    assert "1 imported, 1 there already" in second.err
    assert "2 of 2  missing: contacts and their forces" in second.text
    assert len(discover(tmp_path / "data")) == 2


@pytest.mark.parametrize(
    ("episode", "problem"),
    [
        ("broken", "has no bodies"),
        ({}, "has no bodies"),
        ({"cube": []}, "not every body has a height for each frame"),
        ({"cube": 3}, "not every body has a height for each frame"),
        ({"cube": [1], "cup": [1, 2]}, "not every body has a height for each frame"),
        ({"cube": ["high"]}, "heights are not numbers"),
    ],
)
def test_a_broken_episode_does_not_stop_the_others(source, tmp_path, episode, problem):
    source.write_text(json.dumps({"toy": {"a": episode, "b": {"cube": [1]}}}))
    done = take(source, tmp_path / "data", "--dt", "0.01")
    assert done.code == 2
    assert problem in done.err
    assert "Fix: {" in done.err
    assert [ref.episode_id for ref in discover(tmp_path / "data")] == ["toys/b"]


def test_a_bug_of_an_importer_is_named_as_one(source, tmp_path, monkeypatch):
    def read(self, name, account):
        if name == "a":
            raise UnboundLocalError("z")
        return sound(self, name, account)

    sound = Toy.read
    monkeypatch.setattr(Toy, "read", read)
    done = take(source, tmp_path / "data", "--dt", "0.01")
    assert done.code == 2
    assert "toys.json:a: bug in the toy importer (UnboundLocalError: z)" in done.err
    assert [ref.episode_id for ref in discover(tmp_path / "data")] == ["toys/b"]


def test_what_is_missing_is_named_with_its_remedy(source, tmp_path):
    assert "--dt" in take(source, tmp_path / "data").err
    done = run("import", source, "--to", tmp_path / "data", "--dt", "0.01")
    assert done.code == 2
    assert "--map FILE with [body.cube] shapes" in done.err
    assert not (tmp_path / "data").exists()


def test_a_bind_file_fills_the_header(source, tmp_path):
    bind = tmp_path / "bind.toml"
    bind.write_text(
        '[task.toy]\nroles = { protected = "table" }\nrules = ["FSH101"]\n'
        'set = { edge = "3 cm" }\n[episode.b]\nroles = { target = ["table"] }\n'
    )
    assert take(source, tmp_path / "data", "--dt", "0.01", "--bind", bind).code == 0
    header = load(tmp_path / "data", "toys/b").header
    assert header.roles == {"target": ("table",), "protected": ("table",)}
    assert header.rules == ("FSH101",)
    assert header.parameters == {"edge": "3 cm"}
    bind.write_text("[task.toy]\nroels = {}\n")
    done = take(source, tmp_path / "data", "--dt", "0.01", "--bind", bind)
    assert done.code == 2
    assert "bind.toml:2:1" in done.err


def test_a_mesh_from_a_file(source, tmp_path):
    trimesh.creation.box((60, 60, 60)).export(tmp_path / "cube.stl")
    (tmp_path / "map.toml").write_text(
        '[body."c*"]\nshapes = [{ kind = "convex_mesh", file = "cube.stl", scale = 0.001 }]\n'
    )
    assert take(source, tmp_path / "data", "--dt", "0.01").code == 0
    episode = load(tmp_path / "data", "toys/a")
    mesh = episode.meshes[episode.bodies["cube"].geoms[0].mesh]
    assert np.abs(mesh.vertices).max() == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("text", "place", "told"),
    [
        ("[body.cube]\nmas = 1\n", "2:1", '"mas" is no entry of body.cube'),
        ("[bodies.cube]\nmass = 1\n", "1:2", '"bodies" is no entry of a map file'),
        ('[body.cube]\ncom = [0, 0, "2 kg"]\n', "2:14", "no length"),
        ("[body.cube]\nmass = -1\n", "2:8", "greater than or equal to 0"),
        ('[source]\nquaternion = "zyxw"\n', "2:14", "should be 'wxyz' or 'xyzw'"),
        ('[source]\ndt = "1 parsec"\n', "2:6", "no time"),
        ("[body.cube]\nshapes = [{ kind = 'box', sizes = [1] }]\n", "2:27", '"sizes"'),
        ("path = 3\n", "1:1", '"path" is no entry of a map file'),
        ("[body\n", "1:6", "not valid TOML"),
        ("[episode.z]\nsuccess = true\n", "", "names no episode of the source. Allowed: a, b"),
    ],
)
def test_problems_of_a_map_file_are_pointed_at(source, tmp_path, text, place, told):
    (tmp_path / "map.toml").write_text(text)
    done = take(source, tmp_path / "data", "--dt", "0.01")
    assert done.code == 2
    assert f"map.toml:{place}" in done.err
    assert told in done.err


def test_formats_of_the_simulator_are_known_without_it(monkeypatch):
    monkeypatch.undo()
    monkeypatch.setattr("safestage_eval._process.simulator.why_not", lambda: "pip install it")
    found = registry.importers()
    assert "pip install it" in str(found["mujoco"])
    with pytest.raises(importer.SourceError, match="pip install it"):
        registry.importer("mujoco")
