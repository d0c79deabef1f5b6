"""Campaigns whose policies fail: clear words, the others go on, and all of it can be taken up."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from click import Group
from click.testing import CliRunner

from safestage_eval.formats import discover
from safestage_eval.metrics import aggregate, outcomes
from safestage_eval.run.score_many import score_paths
from simulate.cli.record_command import record as record_command
from simulate.record.campaign import read_campaign
from simulate.record.jobs import GIVES_UP, Outcome, plan, record, recorded_ids
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


def test_what_is_short_of_a_rollout_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dead = tmp_path / "dead"
    monkeypatch.setenv("DEAD", str(dead))
    everything = short(["own_policies:Served", "own_policies:Still"], [0, 1])
    list(record(everything[:1], tmp_path / "out"))
    dead.touch()
    list(record(everything, tmp_path / "out"))
    found = aggregate(outcomes(score_paths([tmp_path / "out"], ["fsh"]).results))
    assert [problem.kind for problem in found.problems] == ["missing"]
    assert "served, default: 1 cell of 2 without a rollout" in found.problems[0].message


def test_a_server_that_is_not_there_is_not_waited_for_all_day(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tries = tmp_path / "tries"
    monkeypatch.setenv("TRIES", str(tries))
    todo = short(["own_policies:Unreachable", "own_policies:Still"], list(range(GIVES_UP + 3)))
    found = list(record(todo, tmp_path / "out"))
    said = [o.problem for o in found if "unreachable" in o.episode_id]
    assert ["no policy server answers" in text for text in said] == [True] * GIVES_UP + [False] * 3
    assert all("not tried" in text for text in said[GIVES_UP:])
    assert len(tries.read_text("utf-8")) == GIVES_UP
    assert [o.aborted for o in found if "unreachable" in o.episode_id] == [True] * GIVES_UP + [
        False
    ] * 3
    assert all(not o.problem for o in found if "still" in o.episode_id)
    list(record(todo[:1], tmp_path / "out"))  # the next run tries again
    assert len(tries.read_text("utf-8")) == GIVES_UP + 1


@contextmanager
def serving(talk: Callable[[Any], None]) -> Iterator[str]:
    """The address of a websocket server that greets as openpi's does, and then goes on as told."""
    from websockets.sync.server import serve

    def greet(socket: Any) -> None:
        socket.send(b"\x80")  # an empty map, in msgpack
        talk(socket)

    with serve(greet, "127.0.0.1", 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"127.0.0.1:{server.socket.getsockname()[1]}"
        finally:
            server.shutdown()
            thread.join()


def rolled(address: str) -> Outcome:
    (found,) = record(short([f"openpi:ws://{address}?timeout=0.3&wait=1"], [0]), Path("unused"))
    return found


@pytest.mark.filterwarnings("ignore:connect")
def test_a_slow_server_and_one_that_hangs_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("websockets")
    monkeypatch.chdir(tmp_path)
    enough = threading.Event()
    with serving(lambda _socket: enough.wait(20) and None) as address:
        slow = rolled(address)
        enough.set()
    assert "gave no answer within 0.3 s" in slow.problem
    with serving(lambda socket: socket.close()) as address:
        gone = rolled(address)
    assert "the connection broke off" in gone.problem
    for outcome in (slow, gone):
        assert outcome.aborted
    (kept,) = discover([Path("unused")])
    assert (kept.fields["termination"], kept.fields["success"]) == ("error", None)
    assert recorded_ids(Path("unused")) == set()


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


def test_a_policy_of_ones_own_in_the_papers_campaign() -> None:
    run = partial(CliRunner().invoke, Group("safestage", commands={"record": record_command}))
    command = ["record", "--campaign", str(PAPER), "--policy", "idle", "--dry-run"]
    found = run([*command, "--share", "1/97"])
    assert found.exit_code == 0, found.output
    assert "1 task, 1 policy, 3 prompts, 3 seeds, 10 rollouts each: 90 rollouts" in found.stdout
    assert "152 h of episode" in run(command).stdout
