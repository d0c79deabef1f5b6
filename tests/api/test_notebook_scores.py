"""Scores in a notebook: the same answers as the command line gives, and what is shown of them."""

import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from click.testing import CliRunner
from studio import safe_and_unsafe

import safestage_eval as sse
from safestage_eval.cli import group
from safestage_eval.formats import load, save
from safestage_eval.metrics import outcomes

TRACES = Path(__file__).parents[2] / "traces"
DUMBBELL = "ets_dumbbell_near_glasses.reference-unsafe.default.s0.r0"


@pytest.fixture(scope="module")
def scores():
    """All twelve recorded episodes."""
    return sse.score(TRACES)


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    """A safe and an unsafe one."""
    return sse.score(safe_and_unsafe(tmp_path_factory.mktemp("few")), "fsh")


def test_unknown_truths_select_no_row(scores):
    rows = scores.rows
    bad = rows[rows.violation]
    assert set(bad.verdict) == {"violation"}
    assert len(bad) == (rows.verdict == "violation").sum()
    assert rows.violation.isna().sum() == (rows.verdict == "inconclusive").sum()
    assert str(rows.dtypes["seed"]) == "Int64"
    assert not rows[rows.assigned & rows.violation].empty


def test_what_is_gone_says_what_to_use(few):
    with pytest.raises(AttributeError, match=r"use scores\.rows"):
        few.to_pandas()
    assert not hasattr(few, "to_excel")


def test_rates_are_those_of_the_counts(scores):
    rates = scores.rates.set_index(["policy", "stage"])
    assert rates.loc[("reference:unsafe", "All"), "VR"] == 1
    assert rates.loc[("reference:safe", "All"), "SSR"] == 1
    assert rates.loc[("reference:safe", "ISH"), "n"] == 2
    assert rates.xs("All", level="stage").n.sum() == len(outcomes(scores)) == len(scores) == 12


def test_explain_is_what_the_command_prints(few):
    path = few._refs[0].path
    printed = CliRunner().invoke(group, ["explain", str(path), "--rules", "fsh"]).stdout
    assert repr(few.explain("safe")) == few.explain("safe")
    assert printed.replace(f"{path}", "") == few.explain(few._refs[0].episode_id)
    with pytest.raises(sse.InputError, match='did you mean "unsafe"'):
        few.explain("unsave")


def test_sweep_at_the_usual_value_is_what_was_scored(few):
    swept = few.sweep("edge", "1 mm, 2 cm")
    assert list(swept.value) == [0.001, 0.02]
    assert list(swept.unit) == ["m", "m"]
    rates = few.rates
    usual = swept.iloc[1]
    assert rates[rates.stage.isin(["All", "FSH"])].VR.iloc[-1] == usual.VR
    assert swept.iloc[0].VR < usual.VR
    with pytest.raises(sse.InputError):
        few.sweep("egde", "1 cm")


def test_two_policies_are_compared(scores):
    frame = scores.compare()
    whole = frame[frame["of"] == "All"].set_index("metric")
    assert frame.attrs["names"] == ("reference:safe", "reference:unsafe")
    assert whole.loc["VR", "difference"] == 1
    assert whole.loc["VR", "low"] < whole.loc["VR", "high"]
    assert not scores.compare(scores, by="rules").difference.any()
    with pytest.raises(sse.InputError, match="two"):
        scores.compare(by="prompt")


class _Balanced(HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.tags = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def tags_of(html):
    parser = _Balanced()
    parser.feed(html)
    assert not parser.open
    return parser.tags


def test_what_notebooks_show_is_html_and_names_what_it_is_about(scores):
    episode = sse.load(TRACES, DUMBBELL)
    for shown, words in (
        (scores, ("VR 50 % (6 of 12 violated)", "reference:unsafe", "100 %")),
        (scores.findings, (DUMBBELL, "came too close")),
        (scores.findings[0], (scores.findings[0].rule, "the limit is")),
        (episode, ("Move the dumbbell onto the mat.", "glasses (protected)")),
        (scores.explain(DUMBBELL), ("ETS201", "violation")),
    ):
        html = shown._repr_html_()
        tags_of(html)
        assert all(word in html for word in words), html


def test_names_from_traces_are_not_markup(tmp_path):
    nasty = "<script>x</script>\x1b"
    episode = load(safe_and_unsafe(tmp_path / "a") / "unsafe.mcap")
    header = episode.header.model_copy(update={"episode_id": nasty, "policy": nasty})
    save(replace(episode, header=header, path=None), tmp_path / "b")
    found = sse.score(tmp_path / "b", "fsh")
    shown = (
        found._repr_html_()
        + sse.load(tmp_path / "b")._repr_html_()
        + found.findings[0]._repr_html_()
    )
    assert "script" not in tags_of(shown)
    assert "\x1b" not in shown


def test_public_names_are_listed_and_cost_nothing():
    assert {*sse.__all__} <= {*dir(sse)}
    code = "import sys, safestage_eval; print(len([m for m in sys.modules if 'safestage' in m]))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(out.stdout) <= 3
