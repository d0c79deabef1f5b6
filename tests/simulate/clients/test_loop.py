"""The loop over a real socket: a served reference does what it does when recorded directly."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import pytest
from sampled import share
from served import blind  # noqa: F401 - a fixture

from safestage_eval.episode import Episode
from safestage_eval.formats import discover
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge
from simulate.policies.policy_names import policy_named
from simulate.record.jobs import plan, record
from simulate.record.rollout import Setting, roll_out
from simulate.servers.serve import serve
from simulate.tasks.task import task_named

pytestmark = pytest.mark.simulate

TRACES = Path(__file__).parents[3] / "traces"
REFS = {ref.episode_id: ref for ref in discover(TRACES)}
TASKS = sorted({str(ref.fields["task"]) for ref in REFS.values()})
PROTOCOLS = ("openpi", "groot", "dreamzero", "cosmos3")
LOOPS = list(zip(TASKS, ("safe", "unsafe", "safe", "unsafe"), PROTOCOLS, strict=False))
"""Every protocol has a task of its own."""


@cache
def recorded(task: str, kind: str) -> tuple[dict[str, str], float | None]:
    episode = REFS[f"{task}.reference-{kind}.default.s0.r0"].open()
    return verdicts(episode), episode.header.success_time


def verdicts(episode: Episode) -> dict[str, str]:
    found = judge(episode, load_rules(["ish", "ets", "fsh"]))
    return {v.rule: v.verdict for v in found.verdicts if v.assigned}


def agrees(task: str, kind: str, protocol: str) -> None:
    name, _, options = protocol.partition("?")
    with serve(f"reference:{kind}", protocol, port=0, task=task) as server:
        rolled_as_recorded(task, kind, f"{name}:{server.url}?{options}&name=model")


def rolled_as_recorded(task: str, kind: str, address: str) -> None:
    """A rollout with a served reference is judged as the one that was recorded directly."""
    episode = roll_out(Setting(task_named(task)), policy_named(address)).episode()
    assert episode.header.termination == "success", episode.header.notes
    assert episode.header.policy == "model"
    expected, time = recorded(task, kind)
    assert verdicts(episode) == expected
    assert ("violation" in expected.values()) == (kind == "unsafe")
    assert episode.header.success_time == pytest.approx(time, abs=0.5)


@pytest.mark.slow
@pytest.mark.usefixtures("blind")
@pytest.mark.parametrize(("task", "kind", "protocol"), share(LOOPS, 4))
def test_a_loop_over_every_protocol(task: str, kind: str, protocol: str) -> None:
    agrees(task, kind, protocol)


@pytest.mark.slow
@pytest.mark.usefixtures("blind")
def test_environments_side_by_side_have_sessions_of_their_own(protocol: str = "openpi") -> None:
    """Two connections to one server at once; it finds out by the prompt which task is whose."""
    tasks = ("fsh_orange_on_plate", "ish_coffee_can_under_bottle")
    with serve("reference:unsafe", protocol, port=0) as server, ThreadPoolExecutor(2) as pool:
        address = f"{protocol}:{server.url}?name=model&timeout=300"
        list(pool.map(lambda task: rolled_as_recorded(task, "unsafe", address), tasks))


@pytest.mark.usefixtures("blind")
@pytest.mark.parametrize("protocol", ["openpi", "dreamzero"])
def test_a_campaign_tells_a_served_reference_its_task_and_seed(
    tmp_path: Path, protocol: str
) -> None:
    """Tasks with the same prompt, on seeds with other layouts; no other server receives them."""
    tasks = [task_named(n) for n in ("ets_apple_past_cans", "ets_apple_over_domino_row")]
    heard: list[str] = []
    with serve("reference:safe", protocol, port=0, tell=heard.append) as server:
        todo = plan(tasks, [f"{protocol}:{server.url}"], [0, 2], horizon=0.4)
        assert [o.problem for o in record(todo, tmp_path)] == [""] * 4
    assert heard == [f"{task.id}, default prompt, seed {seed}" for task in tasks for seed in (0, 2)]
