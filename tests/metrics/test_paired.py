"""Paired comparison against SciPy, statsmodels and pandas."""

from dataclasses import replace

import numpy as np
import pytest
from campaign import campaign, frame
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from statsmodels.stats.contingency_tables import mcnemar as their_mcnemar
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.proportion import confint_proportions_2indep

from safestage_eval.errors import InputError
from safestage_eval.metrics.comparison import compare, differs
from safestage_eval.metrics.paired import KEYS, holm, mcnemar, newcombe, paired, pairs
from safestage_eval.metrics.power import connor


@given(st.integers(0, 400), st.integers(0, 400))
def test_mcnemar_is_that_of_scipy_and_statsmodels(b, c):
    mine = mcnemar(b, c)
    if b + c:
        assert mine == pytest.approx(stats.binomtest(b, b + c).pvalue, rel=1e-9)
    theirs = their_mcnemar([[3, b], [c, 5]], exact=True).pvalue if b + c else 1.0
    assert mine == pytest.approx(min(1.0, theirs), rel=1e-9)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
@settings(max_examples=5)
def test_holm_is_that_of_statsmodels(values):
    assert holm(values) == pytest.approx(list(multipletests(values, method="holm")[1]))


def sides(seed=3, **options):
    outcomes = campaign(seed, **options)
    return [[o for o in outcomes if o.policy == name] for name in ("act", "pi0")]


def joined(a, b, by):
    """The pairs by pandas, decided on both sides, with a column per metric and side."""
    both = frame(a).merge(frame(b), on=list(KEYS[by]), suffixes=("_a", "_b"))
    both = both.dropna(subset=["success_a", "success_b", "violation_a", "violation_b"])
    for side in "ab":
        s, v = (both[f"{name}_{side}"].astype(bool) for name in ("success", "violation"))
        for name, value in {"SR": s, "SSR": s & ~v, "USR": s & v, "VR": v}.items():
            both[f"{name}_{side}"] = value
    return both


def part(both, line):
    column = {"stage": "stage_a", "family": "family_a"}.get(line.level)
    return both if column is None else both[both[column] == line.scope]


@pytest.mark.parametrize("seed", range(2))
def test_counts_are_those_of_pandas(seed):
    a, b = sides(seed, open_share=0.1)
    both = joined(a, b, "policy")
    found = pairs(a, b, "policy")
    assert (len(found.both), len(found.undecided)) == (len(both), len(a) - len(both))
    for line in paired(found):
        own = part(both, line)
        of_a, of_b = own[f"{line.metric}_a"], own[f"{line.metric}_b"]
        only_a, only_b = (of_a & ~of_b).sum(), (of_b & ~of_a).sum()
        assert line.sums == (len(own), of_a.sum(), of_b.sum(), only_a, only_b)
        assert line.difference == pytest.approx(of_b.mean() - of_a.mean())


def test_the_paired_bootstrap_is_that_of_scipy():
    a, b = sides(5, tasks={"ETS": 25})
    (line,) = [x for x in paired(pairs(a, b, "policy")) if (x.scope, x.metric) == ("All", "VR")]
    both = joined(a, b, "policy")
    tasks = both.groupby("task")
    difference = (tasks["VR_b"].sum() - tasks["VR_a"].sum()).to_numpy()
    number = tasks.size().to_numpy()
    theirs = stats.bootstrap(
        (difference, number),
        lambda d, n, axis: d.sum(axis=axis) / n.sum(axis=axis),
        n_resamples=20000, paired=True, vectorized=True, method="percentile",
        rng=np.random.default_rng(11),
    ).confidence_interval  # fmt: skip
    assert line.bootstrap(3, 20000) == pytest.approx((theirs.low, theirs.high), abs=6e-3)
    assert line.bootstrap(3, 500) == line.bootstrap(3, 500) != line.bootstrap(4, 500)


def tables(n):
    """Every way in which n pairs may fall: pairs, k of A, k of B, only A, only B, and how many ways."""
    for both in range(n + 1):
        for only_a in range(n + 1 - both):
            for only_b in range(n + 1 - both - only_a):
                yield n, both + only_a, both + only_b, only_a, only_b


@pytest.mark.parametrize(
    ("sums", "published"),
    [
        ((50, 48, 38, 12, 2), (-0.3404, -0.0569)),  # Newcombe 1998, table II
        ((21, 2, 8, 1, 7), (0.026, 0.507)),  # Fagerland, Lydersen and Laake 2014, airway data
    ],
)
def test_newcombe_is_as_published(sums, published):
    assert newcombe(*sums) == pytest.approx(published, abs=5e-4)


def test_newcombe_without_correlation_is_that_of_statsmodels():
    """Where one side is always the same, the two rates are not correlated."""
    for n, k in ((72, 0), (72, 5), (20, 20), (9, 4)):
        theirs = confint_proportions_2indep(k, n, 0, n, method="newcomb")
        assert newcombe(n, 0, k, 0, k) == pytest.approx(theirs, abs=1e-9)


def test_newcombe_covers_the_truth_as_often_as_it_says():
    """Summed over all tables of 24 pairs, for some true rates; published as 0.95 on average."""
    share = []
    for shares in ((0.02, 0.03, 0.02), (0.3, 0.1, 0.2), (0.5, 0.05, 0.05), (0.1, 0.4, 0.1)):
        true, covered = shares[2] - shares[1], 0.0
        law = stats.multinomial(24, [*shares, 1 - sum(shares)])
        for n, k_a, k_b, only_a, only_b in tables(24):
            low, high = newcombe(n, k_a, k_b, only_a, only_b)
            both = k_a - only_a
            if low <= true <= high:
                covered += law.pmf([both, only_a, only_b, n - both - only_a - only_b])
        share.append(covered)
    assert min(share) > 0.93
    assert 0.94 < np.mean(share) < 0.99


def test_newcombe_holds_the_difference_and_turns_with_the_sides():
    for n, k_a, k_b, only_a, only_b in tables(9):
        low, high = newcombe(n, k_a, k_b, only_a, only_b)
        assert -1 <= low <= (k_b - k_a) / n <= high <= 1
        assert low < high
        assert newcombe(n, k_b, k_a, only_b, only_a) == pytest.approx((-high, -low))


def test_the_sides_may_be_swapped():
    a, b = sides()
    there = compare(a, b, "policy", ("act", "pi0"))
    back = compare(b, a, "policy", ("pi0", "act"))
    for one, two in zip(there.lines, back.lines, strict=True):
        assert one.of.difference == -two.of.difference
        assert (one.p, one.p_holm) == (two.p, two.p_holm)
        if one.interval is not None:  # a family of one task has none
            assert one.interval == pytest.approx([-x for x in reversed(two.interval)])


def test_holm_is_over_the_families_of_a_metric():
    a, b = sides()
    lines = compare(a, b, "policy", ("act", "pi0")).lines
    for level in ("all", "stage", "family"):
        for metric in ("VR",):
            own = [x for x in lines if (x.of.level, x.of.metric) == (level, metric)]
            assert len(own) == {"all": 1, "stage": 3, "family": 6}[level]
            wanted = multipletests([x.p for x in own], method="holm")[1]
            assert [x.p_holm for x in own] == pytest.approx(list(wanted))


def test_a_side_with_itself_shows_no_difference():
    a, _ = sides()
    for line in compare(a, a, "rules", ("old", "new")).lines:
        one = len(line.of.tasks) == 1
        assert (line.p, line.of.difference, line.need) == (1, 0, None)
        if one:
            assert line.interval is None
        else:
            assert line.interval[0] < 0 < line.interval[1]
        assert line.reason == ("one task: no interval over tasks" if one else "no pair differs")
        assert not line.significant


def test_what_has_no_partner_is_counted():
    a, b = sides()
    found = pairs(a[2:], b[:-1], "policy")
    assert [len(x) for x in found.alone] == [1, 2]
    assert len(found.both) == len(a) - 3
    with pytest.raises(InputError, match="no rollout of one is there in the other"):
        pairs(a, [replace(o, seed=99) for o in b], "policy")


def test_open_pairs_bound_the_difference():
    a, b = sides(tasks={"FSH": 2}, rollouts=2)
    b[0] = replace(b[0], violation=None)
    n = len(a)
    for line in paired(pairs(a, b, "policy")):
        worlds = []
        for violation in (False, True):
            closed = [replace(b[0], violation=violation), *b[1:]]
            worlds += [x.difference for x in paired(pairs(a, closed, "policy"))
                       if (x.scope, x.metric) == (line.scope, line.metric)]  # fmt: skip
        assert line.n in (n - 1, n // 2 - 1, n // 2)
        assert (line.least, line.most) == pytest.approx((min(worlds), max(worlds)))


def test_rules_are_paired_by_episode_where_seeds_are_not_named():
    a, _ = sides()
    nameless = [replace(o, seed=None, episode_id=f"e{i}") for i, o in enumerate(a)]
    assert len(pairs(nameless, nameless[::-1], "rules").both) == len(a)


def test_what_two_files_differ_in():
    a, b = sides()
    assert differs(a, b) == "policy"
    assert differs(a, a) == "rules"
    default, specific = ([o for o in a if o.prompt == p] for p in ("default", "specific"))
    assert differs(default, specific) == "prompt"
    with pytest.raises(InputError, match="more than one thing"):
        differs(default, b)


@pytest.mark.parametrize(("only_a", "only_b"), [(0.05, 0.10), (0.2, 0.3), (0.02, 0.2), (0.4, 0.45)])
def test_as_many_pairs_as_it_says_find_the_difference_four_times_of_five(only_a, only_b):
    number = round(connor(only_a + only_b, only_b - only_a))
    drawn = np.random.default_rng(1).multinomial(
        number, [only_a, only_b, 1 - only_a - only_b], size=600
    )
    found = np.mean([mcnemar(int(b), int(c)) < 0.05 for b, c, _ in drawn])
    assert 0.72 < found < 0.84  # the exact test is a little shy
