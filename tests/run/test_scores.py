"""Scoring in several processes says what scoring in one says, whatever happens to a process."""

import os
from dataclasses import fields, replace

import pytest
from studio import block, safe_and_unsafe

from safestage_eval.formats import EpisodeRef, discover, save
from safestage_eval.run.score_many import score_many
from safestage_eval.run.score_traces import score_paths
from safestage_eval.verdicts.problem import Problem


class Deadly(EpisodeRef):
    """An episode that takes the process with it that opens it, as a crashing library would."""

    def open(self, **_):
        os._exit(9)


class Strange(EpisodeRef):
    """An episode that fails in a way nobody has thought of."""

    def open(self, **_):
        raise RuntimeError("out of the blue")


def replace_header(episode, **fields):
    return replace(episode, header=episode.header.model_copy(update=fields))


def turned(ref, kind):
    return kind(**{f.name: getattr(ref, f.name) for f in fields(ref)})


@pytest.fixture(scope="module")
def traces(tmp_path_factory):
    folder = safe_and_unsafe(tmp_path_factory.mktemp("traces"))
    for i in range(3):
        save(block(f"more{i}", room=0.01 * i), folder / f"more{i}.mcap")
    return folder


def test_the_unforeseen_is_listed_with_its_place(traces):
    refs = discover(traces)
    found = score_many([refs[0], turned(refs[1], Strange), refs[2]], ["fsh"])
    assert [isinstance(result, Problem) for result in found] == [False, True, False]
    assert "RuntimeError: out of the blue (test_scores.py:" in found[1].message
    assert found[1].path == str(refs[1].path)


@pytest.mark.slow
def test_several_processes_say_the_same(traces, tmp_path):
    serial, parallel = (score_paths([traces], ["fsh"], jobs=jobs) for jobs in (1, 2))
    assert parallel == serial
    overrides = {"edge": "4 mm"}
    assert score_paths([traces], ["fsh"], jobs=2, overrides=overrides) == score_paths(
        [traces], ["fsh"], jobs=1, overrides=overrides
    )


@pytest.mark.slow
def test_a_process_that_dies_costs_one_episode(traces):
    refs = discover(traces)
    wanted = score_many(refs, ["fsh"], jobs=1)
    steps = []
    found = score_many(
        [turned(ref, Deadly) if i == 2 else replace(ref) for i, ref in enumerate(refs)],
        ["fsh"],
        jobs=2,
        progress=lambda *step: steps.append(step),
    )
    assert isinstance(found[2], Problem)
    assert found[2].path == str(refs[2].path)
    assert "process died" in found[2].message
    assert [r for i, r in enumerate(found) if i != 2] == [r for i, r in enumerate(wanted) if i != 2]
    assert steps == [(i, 5) for i in range(1, 6)]


@pytest.mark.parametrize("form", ["mcap", "parquet"])
def test_a_rollout_that_ended_in_an_error_says_nothing_of_its_policy(tmp_path, form):
    """No success, a violation in sight, and yet no failure: the cell is missing."""

    def keep(name, **fields):
        episode = replace_header(block(name, room=0.0), **fields)
        save(episode, tmp_path / f"{name}.mcap" if form == "mcap" else tmp_path)

    keep("whole")
    alone = score_paths([tmp_path], ["fsh"])
    keep("cut", termination="error", success=None, success_time=None)
    both = score_paths([tmp_path], ["fsh"])
    assert both.aborted == ("cut",)
    assert both.results == alone.results
    assert not both.problems
    asked = score_paths([tmp_path], ["fsh"], where={"termination": "error"})
    assert [r.episode_id for r in asked.results] == ["cut"]


def test_an_attempt_that_failed_gives_way_to_the_next(tmp_path):
    for termination in ("error", "error", "horizon"):
        save(replace_header(block("again"), termination=termination), tmp_path)
        found = discover(tmp_path)
        assert [ref.fields["termination"] for ref in found] == [termination]
    assert len(list((tmp_path / "meta" / "episodes").glob("*.parquet"))) == 3
    save(replace_header(block("again"), termination="error"), tmp_path)  # a later one as well
    assert [ref.fields["termination"] for ref in discover(tmp_path)] == ["horizon"]
    assert score_paths([tmp_path], ["fsh"]).aborted == ()
