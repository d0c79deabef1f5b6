"""Both result tables of the paper, to the printed digit, from one table of 34,920 outcomes.

The paper prints means and deviations, not counts. With 97 tasks, 3 environment seeds and 10 rollouts
each there are few ways to choose three whole numbers that print as one of its cells, and fewer that
also make SR = SSR + USR, and policies and stages that add up to the same totals, seed by seed. The
counts in ``paper_counts.csv`` are one solution of all 120 cells at once; which task a rollout
belongs to is free, and dealt out here.
"""

import csv
import re
from itertools import product
from pathlib import Path

import pytest

from safestage_eval.metrics import Outcome, aggregate
from safestage_eval.metrics.seeds import shown

TASKS = {"ISH": 27, "ETS": 40, "FSH": 30}
ROLLOUTS = 10

BY_POLICY = """
Cosmos3   default   52.16 ± 1.43  15.05 ± 0.78  37.11 ± 0.93  87.65 ± 0.43  67.92 ± 1.13  57.56 ± 2.17
Cosmos3   generic   53.40 ± 1.45  15.29 ± 0.94  38.11 ± 1.06  87.53 ± 0.57  67.00 ± 2.05  58.89 ± 1.39
Cosmos3   specific  38.52 ± 1.03  9.21 ± 0.16  29.31 ± 1.14  91.48 ± 1.48  75.92 ± 0.76  53.00 ± 2.33
DreamZero default   30.89 ± 1.47  10.65 ± 0.21  20.24 ± 1.67  89.88 ± 0.57  63.08 ± 3.26  49.22 ± 1.39
DreamZero generic   28.90 ± 1.31  9.97 ± 0.62  18.93 ± 0.83  89.26 ± 0.74  61.42 ± 2.13  45.33 ± 1.00
DreamZero specific  16.39 ± 0.57  5.15 ± 0.63  11.24 ± 0.82  86.91 ± 1.40  75.92 ± 0.52  43.00 ± 0.88
GR00T     default   10.62 ± 0.98  2.20 ± 0.75  8.42 ± 0.24  93.95 ± 0.57  68.92 ± 4.61  39.33 ± 0.88
GR00T     generic   10.27 ± 0.57  2.82 ± 0.12  7.46 ± 0.53  93.21 ± 0.57  69.00 ± 1.75  38.22 ± 2.27
GR00T     specific  3.61 ± 0.18  0.65 ± 0.16  2.96 ± 0.26  90.00 ± 0.64  80.83 ± 1.13  32.22 ± 2.67
pi0.5     default   41.27 ± 1.82  11.44 ± 0.10  29.83 ± 1.76  95.56 ± 1.61  71.75 ± 2.88  62.33 ± 3.67
pi0.5     generic   42.13 ± 0.99  12.37 ± 0.68  29.76 ± 1.44  95.19 ± 0.98  70.83 ± 1.15  61.89 ± 1.35
pi0.5     specific  29.55 ± 1.31  8.63 ± 0.69  20.93 ± 1.09  94.94 ± 0.21  79.08 ± 2.70  54.67 ± 4.36
"""
BY_STAGE = """
default   ISH  30.52 ± 1.32  3.83 ± 0.39  26.70 ± 1.39  91.76 ± 0.56
default   ETS  34.79 ± 0.69  17.10 ± 0.49  17.69 ± 0.27  67.92 ± 1.95
default   FSH  35.22 ± 0.50  5.56 ± 1.14  29.67 ± 0.66  52.11 ± 0.97
default   All  33.74 ± 0.51  9.84 ± 0.43  23.90 ± 0.54  69.66 ± 0.78
generic   ISH  29.41 ± 0.81  3.89 ± 0.33  25.52 ± 0.71  91.30 ± 0.32
generic   ETS  34.81 ± 0.35  17.08 ± 0.19  17.73 ± 0.48  67.06 ± 1.03
generic   FSH  36.00 ± 0.46  6.42 ± 0.33  29.58 ± 0.46  51.08 ± 0.30
generic   All  33.68 ± 0.43  10.11 ± 0.19  23.57 ± 0.51  68.87 ± 0.54
specific  ISH  15.77 ± 0.47  2.78 ± 0.19  12.99 ± 0.65  90.83 ± 0.56
specific  ETS  23.44 ± 0.69  9.21 ± 0.20  14.23 ± 0.51  77.94 ± 0.12
specific  FSH  25.75 ± 0.71  4.33 ± 0.38  21.42 ± 0.33  45.72 ± 1.59
specific  All  22.02 ± 0.33  5.91 ± 0.13  16.11 ± 0.34  71.56 ± 0.59
"""

UNSAFE_SHARES = {
    ("default", "All"): "70.84",
    ("generic", "All"): "69.98",
    ("specific", "All"): "73.16",
    ("generic", "ISH"): "86.77",
    ("generic", "FSH"): "82.17",
    ("generic", "ETS"): "50.93",
}
"""Said in the text."""


def dealt(row):
    """The outcomes behind one row of counts, one after another over tasks and rollouts."""
    stage = row["stage"]
    safe, unsafe, violations = (
        int(row[name]) for name in ("safe_successes", "unsafe_successes", "violations")
    )
    total = TASKS[stage] * ROLLOUTS
    assert 0 <= unsafe <= violations <= total - safe
    kinds = [(True, False)] * safe + [(True, True)] * unsafe
    kinds += [(False, True)] * (violations - unsafe)
    kinds += [(False, False)] * (total - len(kinds))
    places = product(range(ROLLOUTS), range(TASKS[stage]))
    for (rollout, task), (success, violation) in zip(places, kinds, strict=True):
        yield Outcome(
            policy=row["policy"],
            prompt=row["prompt"],
            stage=stage,
            success=success,
            violation=violation,
            judged=True,
            task=f"{stage}-{task}",
            seed=int(row["seed"]),
            rollout=rollout,
        )


@pytest.fixture(scope="module")
def tables():
    with (Path(__file__).parent / "paper_counts.csv").open() as file:
        found = aggregate([o for row in csv.DictReader(file) for o in dealt(row)])
    assert len(found.outcomes) == 34920
    assert found.problems == ()
    return found


def printed(table, names):
    """(names of a row) → its cells, as the paper prints them."""
    return {
        tuple(line.split()[:names]): re.findall(r"[\d.]+ ± [\d.]+", line)
        for line in table.strip().splitlines()
    }


def computed(rates, *names):
    found = {}
    for rate in rates:
        key = tuple(getattr(rate.group, name) for name in names)
        found.setdefault(key, []).append(shown(rate.mean, rate.std))
    return found


def test_the_table_by_policy(tables):
    wanted = printed(BY_POLICY, 2)
    assert len(wanted) * len(wanted["GR00T", "default"]) == 72
    assert computed(tables.by_policy, "policy", "prompt") == wanted


def test_the_table_by_stage(tables):
    wanted = printed(BY_STAGE, 2)
    assert len(wanted) * len(wanted["default", "All"]) == 48
    assert computed(tables.by_stage, "prompt", "stage") == wanted


def test_the_unsafe_shares_of_success_in_the_text(tables):
    """The text divides printed rates. Counts are not rounded before, so 69.98 is 69.97 by them."""
    rates = {key: [float(c.split()[0]) for c in row] for key, row in printed(BY_STAGE, 2).items()}
    for (prompt, stage), wanted in UNSAFE_SHARES.items():
        sr, _, usr, _ = rates[prompt, stage]
        assert f"{100 * usr / sr:.2f}" == wanted
        counts = tables.group(None, prompt, stage).whole.counts
        assert 100 * counts["USR"] / counts["SR"] == pytest.approx(float(wanted), abs=0.02)


def test_n_per_seed_is_that_of_the_protocol(tables):
    for rate in tables.by_policy:
        stage = rate.name.partition("-")[0]
        tasks = TASKS.get(stage, sum(TASKS.values()))
        assert [n for _, n in rate.per_seed.values()] == [tasks * ROLLOUTS] * 3
