"""Evaluator against people: the same numbers as statsmodels, pandas and pencil and paper."""

import itertools

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from statsmodels.stats import inter_rater
from statsmodels.stats.proportion import proportion_confint

from safestage_eval.metrics.agreement import Confusion, agreement, cohen, fleiss
from safestage_eval.metrics.labels import Label
from safestage_eval.metrics.outcome import Outcome


def judged_(name, stage, violation):
    return Outcome("act", "default", stage, None, violation, judged=True, episode_id=name)


tables = st.lists(st.integers(0, 40), min_size=4, max_size=4)


@given(tables)
def test_cohen_is_statsmodels(cells):
    table = np.reshape(cells, (2, 2))
    found = cohen(table.tolist())
    rows, columns = table.sum(1), table.sum(0)
    if table.sum() == 0 or (rows * columns).sum() == table.sum() ** 2:
        assert found is None
        return
    assert found == pytest.approx(inter_rater.cohens_kappa(table).kappa, abs=1e-12)


@given(st.lists(st.integers(0, 4), min_size=1, max_size=30))
def test_fleiss_is_statsmodels(unsafe):
    counts = [[4 - x, x] for x in unsafe]
    found = fleiss(counts)
    if set(unsafe) in ({0}, {4}):
        assert found is None
        return
    assert found == pytest.approx(inter_rater.fleiss_kappa(np.array(counts)), abs=1e-12)


def test_fleiss_wants_as_many_raters_everywhere():
    for counts in ([[1, 2], [1, 1]], [[1, 0]]):
        with pytest.raises(ValueError, match="same number of raters"):
            fleiss(counts)
    assert fleiss([]) is None


@given(tables)
def test_shares_follow_their_definitions(cells):
    tp, fp, fn, tn = cells
    found = Confusion(tp, fp, fn, tn)
    if tp:
        p, r = tp / (tp + fp), tp / (tp + fn)
        assert (found.precision, found.recall) == (p, r)
        assert found.f1 == pytest.approx(2 * p * r / (p + r))
    elif fp + fn:
        assert found.f1 == 0
    for name, (k, n) in {"precision": (tp, tp + fp), "recall": (tp, tp + fn)}.items():
        low, high = found.intervals.get(name, (None, None))
        expected = proportion_confint(k, n, method="wilson") if n else (None, None)
        assert (low, high) == (pytest.approx(expected[0]), pytest.approx(expected[1]))
    names = ("precision", "recall", "f1", "accuracy", "kappa")
    assert set(found.undefined) == {name for name in names if getattr(found, name) is None}


def test_the_papers_table_can_be_written():
    """95.81 % precision, 98.77 % recall and 97.26 % F1 over 240 episodes: 160 + 7 + 2 + 71."""
    found = Confusion(tp=160, fp=7, fn=2, tn=71)
    assert found.n == 240
    shares = (found.precision, found.recall, found.f1)
    assert [f"{100 * x:.2f}" for x in shares] == ["95.81", "98.77", "97.26"]


answers = st.sampled_from(["safe", "unsafe", "unsure"])
episodes = st.lists(
    st.tuples(
        st.sampled_from(["ISH", "ETS", "FSH"]),
        st.sampled_from([True, False, None]),
        st.lists(answers, min_size=3, max_size=3),
    ),
    max_size=25,
)


@given(episodes)
def test_the_whole_is_what_pandas_counts(drawn):
    judged = [judged_(f"e{i}", stage, violation) for i, (stage, violation, _) in enumerate(drawn)]
    labels = [
        Label(f"e{i}", answer, who)
        for i, (_, _, said) in enumerate(drawn)
        for who, answer in zip(("ada", "bob", "eve"), said, strict=True)
    ]
    found = agreement(labels, judged)

    frame = pd.DataFrame(
        {
            "stage": [x[0] for x in drawn],
            "v": pd.array([x[1] for x in drawn], dtype="boolean"),
            "lead": [x[2].count("unsafe") - x[2].count("safe") for x in drawn],
            "sure": [set(x[2]) != {"unsure"} for x in drawn],
        }
    )
    clear = frame[(frame["lead"] != 0) & frame["v"].notna()]
    for stage, counts in found.stages.items():
        part = clear if stage == "All" else clear[clear["stage"] == stage]
        v, u = part["v"].astype(bool), part["lead"] > 0
        expected = (v & u).sum(), (v & ~u).sum(), (~v & u).sum(), (~v & ~u).sum()
        assert (counts.tp, counts.fp, counts.fn, counts.tn) == expected
    assert sum(found.unsure.values()) == (~frame["sure"]).sum()
    assert sum(found.tied.values()) == (frame["sure"] & (frame["lead"] == 0)).sum()
    assert len(found.undecided) == ((frame["lead"] != 0) & frame["v"].isna()).sum()
    whole = found.stages["All"]
    assert len(found.disagreements) == whole.fp + whole.fn
    assert len(drawn) == whole.n + sum(found.unsure.values()) + sum(found.tied.values()) + len(found.undecided)  # fmt: skip
    for pair, (a, b) in zip(found.pairs, itertools.combinations(range(3), 2), strict=bool(labels)):
        both = [(x[2][a], x[2][b]) for x in drawn if "unsure" not in (x[2][a], x[2][b])]
        assert (pair.n, pair.alike) == (len(both), sum(x == y for x, y in both))


def labels(**said):
    return [Label(name, answer) for name, answer in said.items()]


def test_what_has_no_partner_is_listed_on_both_sides():
    found = agreement(
        labels(a="safe", b="unsafe"), [judged_("b", "ETS", True), judged_("c", "ETS", False)]
    )
    assert found.only_labels == ("a",)
    assert found.only_results == ("c",)
    assert found.stages["All"] == Confusion(tp=1)


def test_the_last_label_of_a_reviewer_counts():
    given = [Label("a", "safe", "ada"), Label("a", "unsafe", "bob"), Label("a", "unsafe", "ada")]
    found = agreement(given, [judged_("a", "ETS", True)])
    assert found.stages["ETS"] == Confusion(tp=1)
    assert found.replaced == 1
    assert found.pairs[0].alike == 1


def test_each_reviewer_is_compared_alone_as_well():
    given = [Label("a", "safe", "ada"), Label("a", "unsafe", "bob"), Label("b", "safe", "bob")]
    found = agreement(given, [judged_("a", "ETS", True), judged_("b", "FSH", False)])
    assert found.tied == {"ETS": 1}
    assert found.reviewers["ada"]["All"] == Confusion(fp=1)
    assert found.reviewers["bob"]["All"] == Confusion(tp=1, tn=1)


def test_without_anything_in_common_every_number_has_a_reason():
    found = agreement([], [])
    whole = found.stages["All"]
    assert whole.undefined == dict.fromkeys(
        ("precision", "recall", "f1", "accuracy", "kappa"), "nothing to compare"
    )
    assert Confusion(tn=5).undefined == {
        "precision": "the evaluator found no violation",
        "recall": "people call nothing unsafe",
        "f1": "nobody found anything unsafe",
        "kappa": "evaluator and people gave one and the same answer throughout",
    }
