"""A source over which a library hangs, swells or dies is a listed problem, and the others are imported."""

from exports import map_text, write_robolab
from scenes import Scene
from studio import run
from unending import opened, without_end

from safestage_eval._process import children
from safestage_eval._process.children import Children, Ended, Question
from safestage_eval.formats import discover, validate


def still(task):
    return Scene(8, 20.0).fixed("table").box("cube", 0.02, (0, 0, 0.02)).episode(task=task)


def test_a_library_that_never_comes_back(tmp_path):
    """HDF5 itself goes round for ever in the texts of this file."""
    bad = write_robolab(tmp_path / "in", [still("A")])
    write_robolab(tmp_path / "in", [still("B")])
    (tmp_path / "map.toml").write_text(map_text(still("A")))
    without_end(bad)
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
