"""Campaigns: every combination, resumable, and safe against processes that die."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from studio import run

from safestage_eval.errors import InputError
from safestage_eval.formats import discover
from simulate.record.campaign import Campaign, read_campaign
from simulate.record.estimate import Estimate, counted
from simulate.record.jobs import (
    plan,
    record,
    recorded_ids,
    summary,
)
from simulate.tasks.task import task_named

pytestmark = pytest.mark.simulate

HERE = Path(__file__).parent


def test_every_combination_of_what_is_chosen() -> None:
    campaign = Campaign(
        policies=("idle", "noisy:0.01"),
        prompts=("default", "specific"),
        tasks=("fsh_*", "ish_bin_with_lemon"),
        stages=("FSH",),
        families=("support*",),
        seeds=(4, 7),
        rollouts=3,
    )
    chosen, jobs = campaign.chosen(), campaign.jobs()
    assert {task.stage for task in chosen} == {"FSH"}
    assert {task.family for task in chosen} == {"support and stability"}
    assert len(jobs) == len(chosen) * 2 * 2 * 2 * 3
    assert len({job.episode_id for job in jobs}) == len(jobs)
    assert {job.setting.seed for job in jobs} == {4, 7}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("tasks = ['fsh_*']", "policies"),
        ("policies = ['idle']\nrolouts = 3", "rolouts"),
        ("policies = ['idle']\nprompts = ['short']", "prompts"),
        ("policies = ['idle'", "not valid TOML"),
    ],
)
def test_mistakes_are_told(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "campaign.toml"
    file.write_text(text, "utf-8")
    with pytest.raises(InputError, match=said):
        read_campaign(file)


@pytest.mark.slow
def test_a_policy_that_kills_or_raises_costs_only_its_own(tmp_path: Path) -> None:
    tasks = [task_named(n) for n in ("fsh_bottle_on_shelf", "fsh_orange_on_plate")]
    policies = ["own_policies:Still", "own_policies:Deadly", "own_policies:Raising"]
    todo = plan(tasks, policies, [0], horizon=0.3)
    found = list(record(todo, tmp_path, jobs=2))
    said = {o.episode_id.split(".h")[0]: o.problem for o in found}
    assert "process died" in said["fsh_orange_on_plate.deadly.default.s0.r0"]
    assert "KeyError" in said["fsh_orange_on_plate.raising.default.s0.r0"]
    assert said["fsh_bottle_on_shelf.deadly.default.s0.r0"] == ""
    good = {o.episode_id for o in found if not o.problem}
    assert len(good) == 3
    assert recorded_ids(tmp_path) == good
    assert summary(found).startswith("3 recorded (0 reached the goal")
    assert summary(found).endswith("2 ended in an error, 1 not recorded")
    again = list(record(plan([tasks[0]], policies[2:], [0], horizon=0.3), tmp_path))
    assert "KeyError" in again[0].problem
    raised = [r for r in discover([tmp_path]) if "raising" in (r.episode_id or "")]
    assert len(raised) == 2, "one of each task; another try leaves nothing behind"
    folder = tmp_path / "meta" / "episodes"
    assert len(list(folder.glob("*.parquet"))) == 3 + 2


@pytest.mark.slow
def test_killed_and_taken_up_again(tmp_path: Path) -> None:
    """Kill -9 in the middle: whole episodes stay, no half one appears, the rest follows."""
    file, out = tmp_path / "campaign.toml", tmp_path / "out"
    file.write_text(
        'policies = ["own_policies:Deadly"]\ntasks = ["fsh_bottle_on_shelf"]\n'
        "seeds = [0, 1, 2, 3]\nhorizon = 0.5\n",
        "utf-8",
    )
    code = (
        "from safestage_eval.cli import main; import sys\n"
        f"sys.argv = ['safestage', 'bench', 'record', '--campaign', {str(file)!r}, '--out', {str(out)!r},"
        " '--jobs', '2']\n"
        "if __name__ == '__main__': main()\n"
    )
    script = tmp_path / "main.py"
    script.write_text(code, "utf-8")
    path = os.pathsep.join([str(HERE), str(HERE.parents[1])])
    environment = {**os.environ, "PYTHONPATH": path}
    first = subprocess.Popen(
        [sys.executable, script], env={**environment, "NAP": "0.5"}, stdout=subprocess.DEVNULL
    )
    end = time.monotonic() + 90
    while not recorded_ids(out):
        assert time.monotonic() < end
        assert first.poll() is None
        time.sleep(0.05)
    first.send_signal(signal.SIGKILL)
    first.wait()
    before = recorded_ids(out)
    assert 1 <= len(before) < 4
    second = subprocess.run(
        [sys.executable, script], env=environment, capture_output=True, text=True, check=True
    )
    assert "there already" in second.stdout
    refs = discover([out])
    assert len(refs) == 4
    assert before <= {ref.episode_id for ref in refs}
    for ref in refs:
        assert ref.problem is None
        assert len(ref.open()) == 64  # eight actions of 1/15 s are the first that last for 0.5 s
    assert second.stderr == ""


def test_a_dry_run_counts_what_is_left(tmp_path: Path) -> None:
    campaign = Campaign(
        policies=("idle", "noisy:0.01"), tasks=("fsh_orange_on_plate",), seeds=(0,), rollouts=3,
        prompts=("default", "generic"), horizon=40.0,
    )  # fmt: skip
    jobs = campaign.jobs()
    assert counted(jobs) == "1 task, 2 policies, 2 prompts, 1 seed, 3 rollouts each: 12 rollouts"
    found = Estimate.of(jobs)
    assert (found.rollouts, found.seconds, found.actions) == (12, 12 * 45, 12 * 40 * 15)
    assert found.horizons == (40, 40)
    assert Estimate.of([]).seconds == 0
    file = tmp_path / "campaign.toml"
    file.write_text('policies = ["idle"]\ntasks = ["fsh_orange_on_plate"]\nhorizon = 0.1', "utf-8")
    command = ["bench", "record", "--campaign", str(file), "--out", str(tmp_path / "out")]
    said = run(*command, "--dry-run").text
    assert "1 seed" not in said
    assert "3 seeds, 1 rollout each: 3 rollouts, 0 of them in" in said
    assert not (tmp_path / "out").exists()
    first = run(*command, "--jobs", "1")
    assert first.code == 0, first.err
    assert ": 3 rollouts, 3 of them in" in run(*command, "--dry-run").text
    assert run(*command, "--share", "2/2").code == 2
