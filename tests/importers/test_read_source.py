"""A source over which a library hangs, swells or dies is a listed problem, and the others are imported."""

import os

import h5py
import numpy as np
import pytest
from exports import map_text, write_robolab
from scenes import Scene
from studio import run
from unending import opened, stillborn, without_end

from safestage_eval._process import children, spawned
from safestage_eval._process.children import Children, Ended, Question
from safestage_eval.errors import InputError
from safestage_eval.formats import discover, validate
from safestage_eval.importers import Settings, hdf5_heaps, read_source
from safestage_eval.importers.hdf5 import open_hdf5
from safestage_eval.importers.import_episode import Target, Task
from safestage_eval.importers.importer import SourceError
from safestage_eval.importers.read_source import AT_LEAST, Limits


def with_texts(path, **options):
    with h5py.File(path, "w", **options) as file:
        data = file.create_group("data")
        data.attrs["env"], data.attrs["model"] = "Lift", "<mujoco/>" * 30
        data["states"] = np.zeros((3, 4))
    return path


@pytest.mark.parametrize("how", ["zeros", "exchanged", "size", "round"])
@pytest.mark.parametrize("libver", ["earliest", "latest"])
def test_texts_without_end_are_refused(tmp_path, how, libver):
    path = with_texts(tmp_path / "x.hdf5", libver=libver)
    open_hdf5(path).close()
    without_end(path, how)
    with pytest.raises(SourceError, match="one without a size"):
        open_hdf5(path)


def test_what_nothing_points_to_harms_nobody(tmp_path):
    """A file whose texts were written anew keeps the old ones' place, whatever is in there now."""
    path = with_texts(tmp_path / "x.hdf5")
    without_end(path, "size")
    data = path.read_bytes()
    path = with_texts(tmp_path / "y.hdf5")
    begin = data.index(b"GCOL")
    with path.open("ab") as stream:
        stream.write(data[begin : begin + 4096])
    with open_hdf5(path) as file:
        assert file["data"].attrs["env"] == "Lift"


def test_texts_across_the_edges_of_blocks(tmp_path, monkeypatch):
    path = with_texts(tmp_path / "x.hdf5")
    without_end(path, "size")
    for block in (7, 8, 100, 2050):
        monkeypatch.setattr(hdf5_heaps, "_BLOCK", block)
        with pytest.raises(SourceError):
            hdf5_heaps.check_heaps(path)


def still(task):
    return Scene(8, 20.0).fixed("table").box("cube", 0.02, (0, 0, 0.02)).episode(task=task)


def test_a_library_that_never_comes_back(tmp_path):
    """A file too large to be looked through first; HDF5 itself hangs in it."""
    bad = write_robolab(tmp_path / "in", [still("A")])
    write_robolab(tmp_path / "in", [still("B")])
    (tmp_path / "map.toml").write_text(map_text(still("A")))
    without_end(bad, "size")
    os.truncate(bad, hdf5_heaps.MOST + 1)
    done = run(
        "import", tmp_path / "in", "--to", tmp_path / "out", "--map", tmp_path / "map.toml",
        "--timeout", "1.5",
    )  # fmt: skip
    assert done.code == 2
    assert done.err.count("longer than 1.5 s (--timeout)") == 1
    assert "1 imported, 0 there already, 1 not imported" in done.err
    assert [ref.episode_id for ref in discover(tmp_path / "out")] == ["in/B/run_0/demo_0"]
    assert validate(tmp_path / "out") == []
    assert not [*(tmp_path / "out").rglob(".*")]


def test_each_trouble_is_reported_and_costs_nobody_else(tmp_path, monkeypatch):
    monkeypatch.setattr(children, "LOADING", 0.0)
    monkeypatch.setattr(children, "AGAIN", 0.0)
    words = ["one", "die", "hang", "two", "swell", "die once", "three"]
    seconds = {"hang": 1.0}
    with Children(2, opened, tmp_path, memory=300 << 20) as pool:
        asked = [Question(word, seconds.get(word, 60.0)) for word in words]
        found = {question.what: answer for question, answer in pool.run(asked)}
        assert pool.ask(Question("again")) == "AGAIN"
    assert {word: found[word] for word in ("one", "two", "three", "die once")} == {
        "one": "ONE", "two": "TWO", "three": "THREE", "die once": "DIE ONCE",
    }  # fmt: skip
    assert found["hang"] == Ended("took longer than 1 s (--timeout)", bound=True)
    assert found["swell"] == Ended("took more than 300 MiB of memory (--memory)", bound=True)
    assert found["die"].why.startswith("its process died twice: SIGSEGV")
    assert [path.name for path in tmp_path.iterdir()] == ["mark"]  # what was half written is gone


def test_processes_that_cannot_begin(monkeypatch):
    monkeypatch.setattr(spawned, "STARTS", 1)
    with Children(1, stillborn) as children, pytest.raises(InputError, match="exit code 3"):
        children.ask(Question("x"))


def test_large_sources_may_take_longer(tmp_path):
    (tmp_path / "in/deep").mkdir(parents=True)
    for name in ("a", "deep/b"):
        (tmp_path / "in" / name).write_bytes(b"")
        os.truncate(tmp_path / "in" / name, 10**9)
    (tmp_path / "small").write_text("x")
    assert Limits().seconds(tmp_path / "small") == pytest.approx(AT_LEAST, abs=0.01)
    assert Limits().seconds(tmp_path / "in") == pytest.approx(AT_LEAST + 4000)
    assert Limits(timeout=3).seconds(tmp_path / "in") == 3


def test_a_source_whose_episodes_all_hang_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(read_source, "GIVEN_UP", 1)
    tasks = [Task("toy", tmp_path / name, str(i), f"{name}/{i}", f"{name}:{i}") for name, i in
             (("a", 0), ("a", 1), ("b", 0), ("a", 2))]  # fmt: skip

    def run(questions):
        for question in questions:
            bad = question.what.path.name == "a"
            yield question, Ended("took longer", bound=True) if bad else "fine"

    apart = read_source.Apart(Target(tmp_path, False, Settings()), Limits(), 1)
    monkeypatch.setattr(apart._children, "run", run)
    found = {task.source: getattr(result, "message", result) for task, result in apart.run(tasks)}
    assert found["b:0"] == "fine"
    assert found["a:0"] == "a:0: importing it took longer"
    assert found["a:1"] == found["a:2"].replace("a:2", "a:1")
    assert found["a:1"].startswith("a:1: not tried, as 1 episode")
