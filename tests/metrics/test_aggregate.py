"""The result tables against pandas one-liners that share nothing with them."""

import math
from dataclasses import replace

import pandas as pd
import pytest
from campaign import campaign, frame
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.errors import InputError
from safestage_eval.metrics import Outcome, aggregate
from safestage_eval.metrics.aggregate import quadrants, rows
from safestage_eval.metrics.seeds import decimal, shown

MAYBE = st.sampled_from([True, True, False, False, None])


@st.composite
def tables(draw):
    """Whatever somebody may have: uneven, undecided, any order."""
    some = st.sampled_from
    return draw(
        st.lists(
            st.builds(
                Outcome,
                policy=some(["pi0", "act"]),
                prompt=some(["default", "specific", "mine"]),
                stage=some(["ISH", "ETS", "FSH"]),
                success=MAYBE,
                violation=MAYBE,
                judged=st.just(True),
                task=some(["a", "b", "c"]),
                family=some(["x", "y"]),
                seed=st.integers(0, 2),
                rollout=st.integers(0, 9),
            ),
            min_size=1,
            max_size=60,
        )
    )


def flags(table):
    """Decided rows, with one column per metric."""
    known = table[table.success.notna() & table.violation.notna()]
    s, v = known.success.astype(bool), known.violation.astype(bool)
    return known.assign(SR=s, SSR=s & ~v, USR=s & v, VR=v)


def check(found, table, keys):
    """mean, std, k, n, n_seeds of every row, by one pandas expression each."""
    known = flags(table)
    for row in found:
        stage, _, metric = row["metric"].rpartition("-")
        part = known[known.stage == stage] if stage else known
        for key in keys:
            if row[key] != "All":
                part = part[part[key] == row[key]]
        per_seed = 100 * part.groupby("seed")[metric].mean()
        assert (row["k"], row["n"], row["n_seeds"]) == (
            part[metric].sum(),
            len(part),
            len(per_seed),
        )
        close(row["mean"], per_seed.mean())
        enough = len(part) and part.groupby("seed").size().min() > 1
        close(row["std"], per_seed.std() if enough else math.nan)


def close(mine, theirs):
    assert (mine is None) == pd.isna(theirs)
    if mine is not None:
        assert math.isclose(mine, theirs, rel_tol=1e-12, abs_tol=1e-9)


@given(tables())
def test_every_rate_is_that_of_pandas(outcomes):
    table, found = frame(outcomes), aggregate(outcomes)
    check(rows(found.by_policy), table, ["policy", "prompt"])
    check(rows(found.by_stage), table, ["prompt", "stage"])
    check(rows(found.by_family), table, ["prompt", "stage", "family"])
    pairs = {(row["policy"], row["prompt"]) for row in rows(found.by_policy)}
    assert pairs == set(table.groupby(["policy", "prompt"]).groups)


@given(tables())
def test_one_n_and_success_is_safe_or_unsafe(outcomes):
    cells = {}
    for row in rows(aggregate(outcomes).by_stage):
        cells.setdefault((row["prompt"], row["stage"]), {})[row["metric"]] = row
    for cell in cells.values():
        assert len({row["n"] for row in cell.values()}) == 1
        if cell["SR"]["n"]:
            close(cell["SR"]["mean"], cell["SSR"]["mean"] + cell["USR"]["mean"])


@given(tables())
def test_quadrants_are_a_cross_table(outcomes):
    table, found = flags(frame(outcomes)), aggregate(outcomes)
    crossed = table.groupby(["SR", "VR"]).size()
    assert quadrants(found.whole) == {
        "safe_success": crossed.get((True, False), 0),
        "unsafe_success": crossed.get((True, True), 0),
        "safe_failure": crossed.get((False, False), 0),
        "unsafe_failure": crossed.get((False, True), 0),
    }


def test_equal_cells_make_no_problems_and_the_mean_is_the_pooled_rate():
    found = aggregate(campaign(1))
    assert found.problems == ()
    for row in rows((*found.by_policy, *found.by_stage)):
        close(row["mean"], 100 * row["k"] / row["n"])


def kinds(outcomes):
    return [(p.kind, p.policy, p.prompt, len(p.cells)) for p in aggregate(outcomes).problems]


def test_an_unequal_cell_is_named():
    outcomes = campaign(1)
    assert kinds(outcomes[1:]) == [("unequal", outcomes[0].policy, outcomes[0].prompt, 1)]
    extra = replace(outcomes[0], rollout=99)
    assert kinds([*outcomes, extra]) == [("unequal", extra.policy, extra.prompt, 1)]


def test_a_prompt_that_a_policy_lacks_is_one_problem():
    outcomes = [o for o in campaign(1) if (o.policy, o.prompt) != ("act", "specific")]
    (problem,) = aggregate(outcomes).problems
    assert (problem.kind, problem.policy, problem.prompt) == ("missing", "act", "specific")
    assert "no rollouts at all" in problem.message


def test_what_is_not_in_n_is_reported_and_bounded():
    outcomes = campaign(1)
    outcomes[0] = replace(outcomes[0], violation=None)
    outcomes[1] = replace(outcomes[1], judged=False, violation=None)
    found = aggregate(outcomes)
    assert [p.kind for p in found.problems] == ["undecided", "not_judged"]
    (rate,) = [r for r in found.by_stage if r.group.stage == "All" and r.metric == "VR"
               and r.group.prompt == outcomes[0].prompt]  # fmt: skip
    least, most = rate.bounds
    assert most - least == pytest.approx(100 / (rate.n + 1))


def test_a_task_in_two_stages_is_reported():
    outcomes = campaign(1)
    other = "ETS" if outcomes[0].stage != "ETS" else "FSH"
    outcomes[0] = replace(outcomes[0], stage=other)
    assert "two_stages" in [p.kind for p in aggregate(outcomes).problems]


def cell(outcomes, metric="SR", stage="FSH"):
    found = aggregate(outcomes).by_stage
    (rate,) = [r for r in found if (r.group.stage, r.metric) == (stage, metric)]
    return rate


def one(success, violation, seed=0, stage="FSH"):
    return Outcome("act", "default", stage, success, violation, judged=True, task="a", seed=seed)


@pytest.mark.parametrize(
    ("outcomes", "said", "reason"),
    [
        ([one(True, True, stage="ETS")], "–", "no episodes"),
        ([one(True, None)], "–", "none of 1 episodes could be decided"),
        ([one(True, True)], "100.00 ± –", "one seed: no deviation"),
        ([one(True, True), one(True, False, 1)] * 2, "100.00 ± 0.00", ""),
        ([one(False, True), one(False, False, 1)] * 2, "0.00 ± 0.00", ""),
        ([one(True, True), one(False, False, 1)], "50.00 ± –", "a seed has one rollout"),
        ([one(True, True), one(False, False, None)], "50.00 ± –", "some episodes name no seed"),
    ],
)
def test_what_cannot_be_computed_is_a_dash_with_a_reason(outcomes, said, reason):
    rate = cell(outcomes)
    assert shown(rate.mean, rate.std) == said
    assert rate.reason.startswith(reason)
    assert bool(rate.reason) == bool(reason)


def test_a_seed_of_which_nothing_is_decided_is_no_seed():
    rate = cell([one(True, True), one(True, None, 1), one(False, True, 2)])
    assert (rate.n_seeds, rate.mean) == (2, 50)


def test_no_minus_zero():
    assert [decimal(x) for x in (-0.001, 0.0, -1.0, None, math.nan)] == [
        "0.00", "0.00", "-1.00", "–", "–",
    ]  # fmt: skip


def test_nothing_is_no_table():
    with pytest.raises(InputError, match="there are none"):
        aggregate([])
