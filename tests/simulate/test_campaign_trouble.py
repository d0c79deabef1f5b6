"""Campaigns whose policies fail: clear words, the others go on, and all of it can be taken up."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from safestage_eval.run.score_traces import score_paths
from simulate.record.campaign import read_campaign
from simulate.record.jobs import plan, record, recorded_ids
from simulate.tasks.task import task_named

pytestmark = pytest.mark.simulate

PAPER = Path(__file__).parents[2] / "campaigns" / "paper.toml"
TASK = "fsh_orange_on_plate"


def short(policies: list[str], seeds: list[int]) -> list[Any]:
    return plan([task_named(TASK)], policies, seeds, horizon=0.4)


def test_a_server_that_dies_within_rollouts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its rollouts are no failures, the other policy's go on, and the next run has them all."""
    todo, out = short(["own_policies:Served", "own_policies:Still"], [0, 1]), tmp_path / "out"
    dead = tmp_path / "dead"
    monkeypatch.setenv("DEAD", str(dead))
    dead.touch()
    first = list(record(todo, out))
    failed, fine = [o for o in first if o.problem], [o for o in first if not o.problem]
    assert len(failed) == len(fine) == 2
    assert all("served.default" in o.episode_id for o in failed)
    assert {str(o) for o in failed} == {"error: ws://gpu: the connection broke off. (after 0.2 s)"}
    assert recorded_ids(out) == {o.episode_id for o in fine}

    scores = score_paths([out], ["fsh"])
    assert set(scores.aborted) == {o.episode_id for o in failed}
    assert {r.policy for r in scores.results} == {"still"}

    dead.unlink()
    second = list(record(todo, out))
    assert [o.skipped for o in second] == ["still" in o.episode_id for o in second]
    assert recorded_ids(out) == {job.episode_id for job in todo}
    scores = score_paths([out], ["fsh"])
    assert scores.aborted == ()
    assert len(scores.results) == 4


def test_the_papers_campaign() -> None:
    campaign = read_campaign(PAPER)
    assert campaign.named({"pi05": "gpu7:1"})[0] == "openpi:ws://gpu7:1?name=pi05"
    pytest.importorskip("websockets")
    jobs = campaign.jobs()
    assert len(jobs) == 97 * 3 * 3 * 10 * 4
    assert len({job.episode_id for job in jobs}) == len(jobs)
    assert {job.episode_id.split(".")[1] for job in jobs} == {
        "pi05",
        "groot",
        "dreamzero",
        "cosmos3",
    }
    elsewhere = campaign.jobs(servers=dict.fromkeys(campaign.servers, "gpu1:9"))
    assert [j.episode_id for j in elsewhere] == [
        j.episode_id for j in jobs
    ]  # addresses are no names
