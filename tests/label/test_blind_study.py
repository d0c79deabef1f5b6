"""The sample of the blind study: half violations in each stage, spread over tasks and noise."""

import importlib.util
from collections import Counter
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "blind_study.py"


@pytest.fixture(scope="module")
def study():
    spec = importlib.util.spec_from_file_location("blind_study", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def rollouts(stage, tasks, violated, seeds=4):
    return [
        {
            "episode_id": f"{stage}.{task}.{noise}.{seed}.{violated}",
            "stage": stage,
            "task": f"{stage}.{task}",
            "policy": f"noisy:{noise}:unsafe" if violated else f"noisy:{noise}",
            "violation": violated,
        }
        for task in range(tasks)
        for noise in ("0.03", "0.06", "0.1")
        for seed in range(seeds)
    ]


def test_it_is_balanced_and_spread(study):
    rows = [row for s in ("ISH", "ETS", "FSH") for v in (True, False) for row in rollouts(s, 5, v)]
    found = study.chosen(rows, 60, 0)
    assert Counter((r["stage"], r["violation"]) for r in found) == {
        (s, v): 10 for s in ("ISH", "ETS", "FSH") for v in (True, False)
    }
    assert set(Counter((r["task"], r["violation"]) for r in found).values()) == {2}
    noises = Counter((r["stage"], r["violation"], study.noise(r)) for r in found)
    assert set(noises.values()) <= {3, 4}
    assert study.chosen(rows[::-1], 60, 0) == found
    assert study.chosen(rows, 60, 1) != found


def test_where_one_verdict_is_rare_the_other_fills_up(study):
    rows = rollouts("ISH", 5, True) + rollouts("ISH", 1, False, 1)
    found = study.chosen(rows, 20, 0)
    assert Counter(r["violation"] for r in found) == {True: 17, False: 3}
    assert len({r["episode_id"] for r in found}) == 20


def test_rules_on_forces_are_left_out(study):
    assert study.unseen() == {"ETS105", "ETS205"}
