"""Runs: the same whether held or on disk, taken up where they stopped, and only what changed anew."""

import json

import pytest
from studio import block, run, safe_and_unsafe

from safestage_eval.formats import load, save
from safestage_eval.run import pool, run_ledger
from safestage_eval.run import score_traces as runs
from safestage_eval.run.score_episode import score_episode
from safestage_eval.run.score_traces import Choice, score_paths
from safestage_eval.run.settings import load_settings


@pytest.fixture
def traces(tmp_path):
    folder = safe_and_unsafe(tmp_path / "traces")
    for i in range(4):
        save(block(f"e{i}", room=0.01 * i, task=f"t{i % 2}"), folder / f"e{i}.mcap")
    save(load(folder / "e0.mcap"), folder / "dataset")  # a copy
    save(block("e1", room=0.1), folder / "z.mcap")  # another one with an id that is taken
    (folder / "broken.mcap").write_bytes(b"\x89MCAP0\r\n and no more")
    return folder


@pytest.fixture
def counted(monkeypatch):
    """Episodes that are judged in this process."""
    done = []
    real = score_episode

    def counting(ref, *args, **kwargs):
        done.append(ref.episode_id)
        return real(ref, *args, **kwargs)

    class Here:
        """An engine that judges right here."""

        def __init__(self, workers, settings, *, lines):
            self._settings, self._rules = settings, settings.rule_set

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def run(self, episodes):
            from safestage_eval.run.worker import line_of

            for number, ref in episodes:
                yield number, line_of(counting(ref, self._rules, **self._settings.arguments()))

    monkeypatch.setattr(pool, "Local", Here)
    return done


def as_held(scores):
    return tuple(scores.results), scores.problems, scores.rules, scores.copies


def test_on_disk_it_is_what_it_is_in_memory(traces, tmp_path, counted):
    held = score_paths([traces], ["fsh"])
    stored = runs.score_traces([traces], load_settings(["fsh"]), Choice(resume=tmp_path / "kept"))
    assert as_held(stored) == as_held(held)
    assert len(held.copies) == 1
    assert len(held.problems) == 2


def test_a_second_run_judges_only_what_is_new(traces, tmp_path, counted):
    choice = Choice(resume=tmp_path / "kept")
    first = runs.score_traces([traces], load_settings(["fsh"]), choice)
    assert len(counted) == 9
    counted.clear()
    save(block("new"), traces / "new.mcap")
    second = runs.score_traces([traces], load_settings(["fsh"]), choice)
    assert sorted(counted) == ["", "new"]  # what was a problem is tried again
    assert [r for r in second.results if r.episode_id != "new"] == list(first.results)


@pytest.mark.parametrize(
    "changed",
    [
        {"overrides": {"edge": "4 mm"}},
        {"assigned_only": True},
    ],
    ids=lambda changed: next(iter(changed)),
)
def test_what_was_asked_otherwise_is_answered_anew(traces, tmp_path, counted, changed):
    choice = Choice(resume=tmp_path / "kept")
    runs.score_traces([traces], load_settings(["fsh"]), choice)
    counted.clear()
    found = runs.score_traces([traces], load_settings(["fsh"], **changed), choice)
    assert as_held(found) == as_held(score_paths([traces], ["fsh"], **changed))
    assert len(counted) == 9


@pytest.mark.slow
def test_a_long_run_goes_through_processes_and_disk(traces, monkeypatch):
    monkeypatch.setattr(runs, "IN_MEMORY", 3)
    monkeypatch.setattr(run_ledger, "WAITING", 2)
    steps = []
    found = runs.score_traces(
        [traces], load_settings(["fsh"]), Choice(jobs=2), lambda *step: steps.append(step)
    )
    assert as_held(found) == as_held(score_paths([traces], ["fsh"], jobs=1))
    assert [done for done, _ in steps] == list(range(1, 10))
    assert steps[-1][1] == 9


@pytest.mark.slow
def test_the_command_keeps_and_takes_up(traces, tmp_path):
    """Same bytes out, whatever was kept; the sample is reported."""
    plain = [run("score", traces, "-r", "fsh", "-f", form) for form in ("json", "csv", "jsonl")]
    kept = tmp_path / "kept"
    for _ in range(2):
        for form, wanted in zip(("json", "csv", "jsonl"), plain, strict=True):
            found = run("score", traces, "-r", "fsh", "-f", form, "--resume", kept, "-j", "1")
            assert (found.code, found.out) == (2, wanted.out)
    some = run("score", traces, "-r", "fsh", "-f", "json", "--sample", "3")
    assert "a sample: 3 of 9 episodes" in some.err
    assert json.loads(some.text)["sample"].startswith("a sample: 3 of 9")
    assert "a sample: 3 of 9" in run("score", traces, "-r", "fsh", "--sample", "3").text
