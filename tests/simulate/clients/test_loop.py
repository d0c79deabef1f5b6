"""The loop over a real socket: a served reference does what it does when recorded directly."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
from served import blind  # noqa: F401 - a fixture

from safestage_eval.episode import Episode
from safestage_eval.formats import discover
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge
from simulate.policies import policy_named
from simulate.rollout import Setting, roll_out
from simulate.servers.serve import serve
from simulate.task import task_named

pytestmark = pytest.mark.simulate

TRACES = Path(__file__).parents[3] / "traces"
REFS = {ref.episode_id: ref for ref in discover(TRACES)}
TASKS = sorted({str(ref.fields["task"]) for ref in REFS.values()})
PROTOCOLS = ("openpi", "groot", "dreamzero", "cosmos3")


@cache
def recorded(task: str, kind: str) -> tuple[dict[str, str], float | None]:
    episode = REFS[f"{task}.reference-{kind}.default.s0.r0"].open()
    return verdicts(episode), episode.header.success_time


def verdicts(episode: Episode) -> dict[str, str]:
    found = judge(episode, load_rules(["ish", "ets", "fsh"]))
    return {v.rule: v.verdict for v in found.verdicts if v.assigned}


def served(task: str, kind: str, protocol: str) -> Episode:
    name, _, options = protocol.partition("?")
    with serve(f"reference:{kind}", protocol, port=0, task=task) as server:
        address = f"{name}:{server.url}?{options}&name=model"
        return roll_out(Setting(task_named(task)), policy_named(address)).episode()


def agrees(task: str, kind: str, protocol: str) -> None:
    episode = served(task, kind, protocol)
    assert episode.header.termination == "success", episode.header.notes
    assert episode.header.policy == "model"
    expected, time = recorded(task, kind)
    assert verdicts(episode) == expected
    assert ("violation" in expected.values()) == (kind == "unsafe")
    assert episode.header.success_time == pytest.approx(time, abs=0.5)


@pytest.mark.usefixtures("blind")
def test_a_loop_over_a_websocket() -> None:
    agrees("fsh_orange_on_plate", "safe", "openpi")


@pytest.mark.slow
@pytest.mark.usefixtures("blind")
@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("task", TASKS)
def test_safe_and_unsafe_over_every_protocol(task: str, protocol: str) -> None:
    for kind in ("safe", "unsafe"):
        agrees(task, kind, protocol)


@pytest.mark.slow
@pytest.mark.usefixtures("blind")
def test_a_loop_of_velocities() -> None:
    agrees("fsh_orange_on_plate", "unsafe", "openpi?actions=velocity")


def test_there_are_six_tasks() -> None:
    assert len(TASKS) == 6
