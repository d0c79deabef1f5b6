"""A rollout that is watched: violations told at once, and a run that ends with the first."""

from __future__ import annotations

from pathlib import Path

import pytest
from studio import run

from safestage_eval.formats import load
from safestage_eval.rules import load_rules
from safestage_eval.run.score_traces import score_paths
from safestage_eval.verdicts import judge

pytestmark = pytest.mark.simulate


def test_it_ends_at_the_first_violation_and_the_trace_agrees(tmp_path: Path) -> None:
    command = [
        "bench",
        "record",
        "ets_dumbbell_near_glasses",
        "--policy",
        "reference:unsafe",
        "--seeds",
        "0",
    ]
    command += ["--stop-at-violation", "--out", str(tmp_path), "--jobs", "1"]
    found = run(*command)
    assert found.code == 0, found.err
    assert "stopped at the first violation: ETS201 at " in found.text
    assert "r0: ETS201 at 4." in found.err
    episode = load(tmp_path)
    assert (episode.header.termination, episode.header.success) == ("truncated", False)
    (offline,) = judge(episode, load_rules(["ets"]), assigned_only=True).verdicts
    assert offline.verdict == "violation"
    assert offline.time is not None
    assert offline.time <= episode.t[-1] < offline.time + 0.3  # a look every quarter of a second
    assert f"ETS201 at {offline.time:.2f} s" in episode.header.notes[-1]
    (result,) = score_paths([tmp_path], ["ets"], assigned_only=True).results
    assert (result.success, result.violation) == (False, True)
    assert "there already" in run(*command).text
