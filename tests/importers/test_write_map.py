"""A map file to begin with: it loads, and completed it imports."""

import pytest
from exports import write_maniskill
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
