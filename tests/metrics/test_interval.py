"""Intervals against statsmodels and SciPy."""

import numpy as np
import pytest
from campaign import campaign
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from statsmodels.stats.proportion import proportion_confint

from safestage_eval.metrics import aggregate
from safestage_eval.metrics.interval import bootstrap, in_strata, sizes, weights, wilson


@given(st.integers(1, 3000), st.floats(0, 1), st.sampled_from([0.8, 0.95, 0.99]))
def test_wilson_is_that_of_statsmodels(n, share, confidence):
    k = round(share * n)
    low, high = proportion_confint(k, n, 1 - confidence, method="wilson")
    assert wilson(k, n, confidence) == pytest.approx((low, high), abs=1e-12)


def test_wilson_of_nothing_is_nothing():
    assert wilson(0, 0) is None


def rate_of(outcomes, metric="SR", stage="ETS"):
    found = aggregate(outcomes).by_stage
    return next(r for r in found if (r.group.stage, r.metric) == (stage, metric))


def per_task(rate):
    cells = rate.group.by_task
    return np.array(
        [[cells[t].counts[rate.metric], cells[t].n] for t in in_strata(rate.group.strata)]
    )


@pytest.mark.parametrize("metric", ["SR", "SSR", "USR", "VR"])
def test_the_bootstrap_over_tasks_is_that_of_scipy(metric):
    rate = rate_of(campaign(4, tasks={"ETS": 25}, open_share=0.05), metric)
    k, n = per_task(rate).T
    found = stats.bootstrap(
        (k, n),
        lambda k, n, axis: k.sum(axis=axis) / n.sum(axis=axis),
        n_resamples=20000, paired=True, vectorized=True, method="percentile",
        rng=np.random.default_rng(11),
    ).confidence_interval  # fmt: skip
    mine = bootstrap(rate, seed=5, resamples=20000)
    assert mine == pytest.approx((found.low, found.high), abs=4e-3)


def test_the_bootstrap_is_repeatable():
    rate = rate_of(campaign(4))
    assert bootstrap(rate, 1, 500) == bootstrap(rate_of(campaign(4)), 1, 500)
    assert bootstrap(rate, 1, 500) != bootstrap(rate, 2, 500)


def test_tasks_are_drawn_within_their_stage():
    rate = rate_of(campaign(4), stage="All")
    drawn = weights(sizes(rate.group.strata), 3, 400)
    stages = np.array([rate.group.strata[t] for t in in_strata(rate.group.strata)])
    for stage in set(stages):
        of_stage = stages == stage
        assert (drawn[:, of_stage].sum(axis=1) == of_stage.sum()).all()
        assert abs(drawn[:, of_stage].mean() - 1) < 1e-12


def test_a_rate_that_all_tasks_share_has_no_width_and_one_task_no_interval():
    sure = [o for o in campaign(4) if o.success]
    low, high = bootstrap(rate_of(sure))
    assert low == high == 1
    assert bootstrap(rate_of(campaign(4, tasks={"ETS": 1}))) is None


def test_tasks_that_differ_make_it_wider_than_wilson():
    def width(pair):
        return pair[1] - pair[0]

    alike, apart = (rate_of(campaign(8, tasks={"ETS": 30}, spread=s)) for s in (0.0, 0.5))
    assert width(bootstrap(apart)) > 2 * width(wilson(apart.k, apart.n))
    assert width(bootstrap(alike)) < 1.3 * width(wilson(alike.k, alike.n))
