"""A map file to begin with: it loads, and completed it imports."""

import json

import h5py
import pytest
from exports import write_lerobot, write_maniskill
from scenes import Scene
from studio import run

from safestage_eval.importers import load_map


def scene():
    s = Scene(30, 20.0).fixed("table-workspace").box("cubeA", 0.02, (0, 0, 0.02))
    return s.box("milk 1", 0.03, (0.3, 0, 0.03)).episode(task="Pick the cubeA")


def written(source, to, *more):
    done = run("import", source, "--write-map", to, *more)
    assert done.code == 0, done.err
    return to.read_text()


def test_a_skeleton_names_every_body_and_what_is_missing(tmp_path):
    source = write_maniskill(tmp_path / "in", scene(), rate=False)
    text = written(source, tmp_path / "map.toml")
    map_ = load_map(tmp_path / "map.toml")
    assert {"cubeA", "milk 1", "table-workspace"} <= set(map_.body)
    assert map_.body["table-workspace"].kind == "fixture"
    for what in (
        "# Missing: the time between its rows",
        "# Missing: no object has a shape",
        "# shapes",
    ):
        assert what in text


def test_with_its_comments_taken_away_it_imports(tmp_path):
    source = write_maniskill(tmp_path / "in", scene())
    text = written(source, tmp_path / "map.toml")
    full = "\n".join(
        line.removeprefix("# ")
        if line.startswith(("# shapes", "# mass", "# cavity", "# up"))
        else line
        for line in text.splitlines()
    )
    (tmp_path / "full.toml").write_text(full)
    done = run("import", source, "--to", tmp_path / "data", "--map", tmp_path / "full.toml")
    assert done.code == 0, done.err
    assert "names no body" not in done.err


def test_tables_show_their_columns(tmp_path):
    source, _ = write_lerobot(tmp_path / "in", [scene()])
    text = written(source, tmp_path / "map.toml")
    assert "observation.environment_state[0:21]" in text
    assert load_map(tmp_path / "map.toml").columns is not None


def test_an_existing_file_is_kept(tmp_path):
    source = write_maniskill(tmp_path / "in", scene())
    (tmp_path / "map.toml").write_text("# mine")
    done = run("import", source, "--write-map", tmp_path / "map.toml")
    assert done.code == 2
    assert (tmp_path / "map.toml").read_text() == "# mine"


def test_what_nothing_can_be_read_from_is_refused(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["a"] = [1]
    done = run("import", tmp_path / "x.h5", "--write-map", tmp_path / "map.toml")
    assert done.code == 2
    assert not (tmp_path / "map.toml").exists()
    assert run("import", tmp_path / "none.h5", "--write-map", tmp_path / "m.toml").code == 2


def test_one_map_for_several_files(tmp_path):
    write_maniskill(tmp_path / "in" / "PickCube", scene())
    write_maniskill(tmp_path / "in" / "StackCube", scene())
    box = 'shapes = [{ kind = "box", size = [%s, %s, %s] }]\n'
    (tmp_path / "map.toml").write_text(
        '[body."*"]\n' + box % (0.02, 0.02, 0.02)
        + '[body.cubeA]\nmass = 0.3\n[in."StackCube/*".body.cubeA]\n' + box % (0.05, 0.05, 0.05)
        + '[in."StackCube/*".every]\npolicy = "planner"\n'
    )  # fmt: skip
    done = run("import", tmp_path / "in", "--to", tmp_path / "data", "--map", tmp_path / "map.toml")
    assert done.code == 0, done.err
    from safestage_eval.formats import discover

    heads = {ref.episode_id: ref.open().header for ref in discover([tmp_path / "data"])}
    sizes = {}
    for name, header in heads.items():
        [cube] = [body for body in header.bodies if body.name == "cubeA"]
        sizes[name.split("/")[1]] = cube.geoms[0].size[0], cube.mass, header.policy == "planner"
    assert sizes == {
        "PickCube": (pytest.approx(0.02), 0.3, False), "StackCube": (pytest.approx(0.05), 0.3, True),
    }  # fmt: skip


def test_replace_takes_the_place_of_what_is_there(tmp_path):
    source = write_maniskill(tmp_path / "in", scene())
    for size in (0.02, 0.05):
        (tmp_path / "map.toml").write_text(
            f'[body."*"]\nshapes = [{{ kind = "box", size = [{size}, {size}, {size}] }}]\n'
        )
        args = ["import", source, "--to", tmp_path / "data", "--map", tmp_path / "map.toml"]
        done = run(*args, "-f", "json")
        if size == 0.05:
            assert done.code == 2
            assert "--replace" in done.err
            done = run(*args, "--replace", "-f", "json")
        assert done.code == 0, done.err
        [one] = json.loads(done.out)["episodes"]
        assert one["new"]
    from safestage_eval.formats import load

    assert load(tmp_path / "data").bodies["cubeA"].geoms[0].size[0] == pytest.approx(0.05)
    assert len(list((tmp_path / "data" / "meta/episodes").glob("*.parquet"))) == 1
    again = run(*args, "--replace", "-f", "json")
    assert not json.loads(again.out)["episodes"][0]["new"]
