"""``safestage plot``: what is asked for, with the limits that are set to it."""

import re
from pathlib import Path

import numpy as np
import pytest
from moving import path_of, pushed

from safestage_eval.errors import InputError
from safestage_eval.formats import load
from safestage_eval.palette import GROUNDS
from safestage_eval.report import signal_plot
from safestage_eval.rules import load_rules
from safestage_eval.whatif.judge_again import Again


@pytest.fixture
def again(tmp_path):
    return pushed(tmp_path)


def test_a_signal_comes_with_the_limits_of_all_rules_that_read_it(again):
    (panel,) = signal_plot.panels(again, ["displacement(target)"])
    assert panel.name == "displacement(cube)"
    assert panel.series.value == pytest.approx(path_of(again.episode.t), abs=1e-6)
    assert {(b.value, code) for b, code in panel.limits} == {(0.02, "ETS901"), (0.09, "ETS902")}
    assert {v.rule: v.verdict for v in panel.verdicts} == {"ETS901": "violation", "ETS902": "pass"}


def test_progress_counts_the_signals(again):
    steps = []
    drawn = signal_plot.panels(again, [], progress=lambda *now: steps.append(now))
    assert steps == [(0, None), *((n + 1, len(drawn)) for n in range(len(drawn)))]


def test_without_a_signal_the_decisive_ones_are_drawn(again):
    names = [panel.name for panel in signal_plot.panels(again, [])]
    decisive = [again.usual(rule).signal for rule in again.assigned]
    assert names == list(dict.fromkeys(decisive))


def test_a_signal_that_no_rule_reads_has_no_limit(again):
    (panel,) = signal_plot.panels(again, ["height(ball)"])
    assert panel.limits == () and panel.verdicts == ()
    assert panel.series.value == pytest.approx(0.02, abs=1e-6)


def test_a_signal_that_rules_declare_is_drawn(again):
    (panel,) = signal_plot.panels(again, ["mean_speed(cube)"])
    went = np.gradient(path_of(again.episode.t), again.episode.t)
    assert panel.series.value.max() == pytest.approx(went.max(), rel=0.05)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("hight(cube)", 'no signal .*did you mean "height"'),
        ("height(mug)", "no role or body"),
        ("height(cub)", 'no role or body .*did you mean "cube"'),
        ("height(cube, ball)", "takes"),
        ("height(ball) since success", "no rule that was judged"),
    ],
)
def test_what_does_not_exist_is_said(again, asked, said):
    with pytest.raises(InputError, match=said):
        signal_plot.panels(again, [asked])


def test_where_a_moment_decides_what_it_is_made_of_is_drawn():
    path = Path(__file__).parents[2] / "traces"
    for name in (
        "ish_coffee_can_under_bottle.reference-safe",
        "ish_bin_with_lemon.reference-unsafe",
    ):
        again = Again(load(path, f"{name}.default.s0.r0"), load_rules(["ish"]), {}, None)
        drawn = signal_plot.panels(again, [])
        assert {panel.name.partition("(")[0] for panel in drawn} == {"lift", "displacement"}
        assert all(panel.limits and panel.verdicts for panel in drawn)


def test_nothing_decides_nothing_is_drawn(tmp_path):
    again = pushed(tmp_path, rules=("ETS999",))
    with pytest.raises(InputError, match="no measurement decides"):
        signal_plot.panels(again, [])


def test_the_picture_names_signal_limit_and_verdict(again, tmp_path):
    mpl = pytest.importorskip("matplotlib")
    file = tmp_path / "new folder" / "why.svg"
    with mpl.rc_context({"svg.fonttype": "none"}):
        signal_plot.draw(again, signal_plot.panels(again, ["displacement(cube)"]), file)
    said = re.sub(r"<[^>]+>", " ", file.read_text("utf-8"))
    for word in (
        "displacement(cube) (cm)",
        "ETS901: push 2.0 cm",
        "✕ ETS901 violation",
        "time (s)",
    ):
        assert word in said
    assert re.search(r"\d cm at \d\.\d\d s", said)  # beside the worst dot
    dark = tmp_path / "dark.svg"
    signal_plot.draw(again, signal_plot.panels(again, ["displacement(cube)"]), dark, dark=True)
    assert GROUNDS["surface"].dark in dark.read_text("utf-8")
    with pytest.raises(InputError, match="Allowed: a name ending in"):
        signal_plot.draw(
            again, signal_plot.panels(again, ["displacement(cube)"]), tmp_path / "why.xyz"
        )
