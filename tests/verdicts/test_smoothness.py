"""Windows, smoothness, products, states as numbers, and changes since an event, in computed signals."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from growing import growing
from resampled import cut_out, resampled
from scenes import Scene

from safestage_eval.episode import Episode
from safestage_eval.monitor import Monitor
from safestage_eval.rules.check import check
from safestage_eval.rules.load import RuleFile, merge
from safestage_eval.rules.syntax import RuleSet
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.ask import ask
from safestage_eval.whatif.judge_again import Again
from safestage_eval.whatif.swept_values import like
from safestage_eval.whatif.value_ranges import all_pieces

FILE = '[ruleset]\nformat = 1\nname = "t"\nversion = "1"\n'
ONE = '[[rule]]\ncode = "ETS901"\ntitle = "t"\nroles = { a = "object" }\n'


def rules(text: str) -> RuleSet:
    file = RuleFile("test.toml", FILE + text, tomllib.loads(FILE + text), asked=True)
    assert check([file]) == []
    return merge([file])


SMOOTH = """
[signal.x]
base = "coordinate"
axis = "x"
[signal.v]
of = ["a"]
derivative = "x(a)"
over = "2 frames @ 15 Hz"
[signal.acceleration]
of = ["a"]
derivative = "v(a)"
over = "2 frames @ 15 Hz"
[signal.jerk]
of = ["a"]
derivative = "acceleration(a)"
over = "2 frames @ 15 Hz"
[signal.pace]
of = ["a"]
abs = "v(a)"
[signal.smooth]
of = ["a"]
sparc = "pace(a)"
[signal.way]
of = ["a"]
integral = "pace(a)"
[signal.far]
of = ["a"]
when = { "x(a)" = ">= 1 m" }
[signal.is_far]
of = ["a"]
holds = "far(a)"
[signal.share]
of = ["a"]
product = ["x(a)", 0.5]
""".replace("[signal.far]", "[state.far]")
ALL = (
    ONE.replace("ETS901", "ETS903")
    + """[rule.require]
"jerk(a)" = "<= 1000000 m/s^3"
"smooth(a)" = "<= 0"
"way(a)" = "<= 1000 m"
"is_far(a)" = "<= 100 %"
"share(a)" = "<= 1000000 m"
"""
)


def sliding(x, rate: float, **more) -> Episode:
    """a slides along x, place by place."""
    place = np.column_stack([x, 0 * x, 0 * x])
    return Scene(len(x), rate).box("a", 0.02, place).episode(roles={"a": ("a",)}, **more)


def cubic(rate: float, seconds: float = 4.0) -> Episode:
    """Positions of a motion with a jerk of 0.6 m/s³ throughout."""
    t = np.arange(round(seconds * rate)) / rate
    return sliding(0.1 * t**3 - 0.05 * t, rate)


@pytest.mark.parametrize("rate", [15.0, 30.0, 60.0, 120.0])
def test_a_jerk_over_a_window_is_the_same_at_every_rate(rate) -> None:
    found = ask(cubic(rate), "jerk(a)", None, rules(SMOOTH + ALL))
    inner = slice(round(0.3 * rate), -round(0.3 * rate))
    assert found.lower[inner] == pytest.approx(0.6, rel=2e-2)


def test_a_recording_too_coarse_for_the_window_tells_nothing() -> None:
    found = ask(cubic(10.0), "v(a)", None, rules(SMOOTH + ALL))
    assert np.isneginf(found.lower[1:-1]).all()
    assert np.isposinf(found.upper[1:-1]).all()


def test_smoothness_is_that_of_the_whole_motion_until_then() -> None:
    t = np.arange(360) / 60
    bell, twice = (0.3 * np.exp(-(((t - 3) / 0.4) ** 2)), np.exp(-(((t - 1.5) / 0.3) ** 2)))
    twice = 0.2 * (twice + np.exp(-(((t - 4) / 0.3) ** 2)))
    one, two = (
        ask(sliding(np.cumsum(v) / 60, 60.0), "smooth(a)", None, rules(SMOOTH + ALL))
        for v in (bell, twice)
    )
    assert -2 < one.lower[-1] == one.upper[-1] < -1
    assert two.upper[-1] < one.lower[-1] - 0.3
    still = ask(sliding(0 * t, 60.0), "smooth(a)", None, rules(SMOOTH + ALL))
    assert (still.lower[-1], still.upper[-1]) == (-np.inf, 0)
    assert still.notes == ("smooth() of what has not moved is not known",)
    holed = ask(
        cut_out(sliding(np.cumsum(bell) / 60, 60.0), 2.5, 3.5),
        "smooth(a)",
        None,
        rules(SMOOTH + ALL),
    )
    assert (holed.lower[-1], holed.upper[-1]) == (-np.inf, 0)


def test_a_hole_makes_a_verdict_on_what_is_computed_no_safer() -> None:
    """Whatever is cut out of a recording that is violated, it does not pass."""
    episode = cubic(60.0)
    for condition in (
        '"jerk(a)" = "<= 0.5 m/s^3"',
        '"smooth(a)" = ">= -1"',
        '"way(a)" = "<= 1 m"',
        '"way(a) since far(a)" = "<= 1 m"',
        '"is_far(a)" = "<= 50 %"',
        '"share(a)" = "<= 50 cm"',
    ):
        declared = rules(SMOOTH + ALL + ONE + f"require = {{ {condition} }}\n")

        def verdict(one: Episode, of: RuleSet = declared) -> str:
            return next(v for v in judge(one, of).verdicts if v.rule == "ETS901").verdict

        assert verdict(episode) == "violation", condition
        for begin in (0.5, 2.0, 3.0):
            assert verdict(cut_out(episode, begin, begin + 0.8)) != "pass", condition
            short = resampled(episode, np.flatnonzero(episode.t < begin), termination="truncated")
            assert verdict(short) != "pass", condition


def test_the_change_of_a_computed_signal_since_an_event() -> None:
    """The way since it was 1 m away is what it went from there on."""
    episode = cubic(60.0)
    text = SMOOTH + ALL + ONE + 'require = { "way(a) since far(a)" = "<= 1 m" }\n'
    found = next(v for v in judge(episode, rules(text)).verdicts if v.rule == "ETS901")
    x = episode.track("a").position[:, 0]
    start = int(np.argmax(x >= 1))
    assert found.value == pytest.approx(float(x[-1] - x[start]), rel=2e-2)


@pytest.mark.parametrize(
    ("condition", "param", "value"),
    [
        ('"jerk(a)" = "<= limit"', "limit", "0.5 m/s^3"),
        ('"smooth(a)" = "<= limit"', "limit", "1"),
        ('"way(a) since far(a)" = "<= limit"', "limit", "1 m"),
        ('"share(a)" = "<= limit"', "limit", "0.5 m"),
        ('"is_far(a)" = "<= 50 %"', "remote", "2 m"),
        ('"way(a) since far(a)" = "<= 3 m"', "remote", "2 m"),
        ('"jerk(a)" = "<= 59 cm/s^3"', "window", "0.1 s"),
    ],
)
def test_what_the_table_says_of_computed_signals_is_what_judging_says(condition, param, value):
    """Of any value of a parameter; and the monitor says of the recorded one what judging says."""
    episode = cubic(60.0, seconds=3.0)
    held = value if param == "limit" and " " not in value else f'"{value}"'
    text = SMOOTH + ALL + ONE + f"require = {{ {condition} }}\n[param]\n{param} = {held}\n"
    if param == "remote":
        text = text.replace(">= 1 m", ">= remote")
    if param == "window":
        text = text.replace('over = "2 frames @ 15 Hz"', 'over = "window"')
    found = rules(text)
    rule, again = found.rules["ETS901"], Again(episode, found)
    params = again.binding.params(rule)
    for piece in all_pieces(again, rule, [param])[param]:
        number = (piece.low + min(piece.high, 10)) / 2
        if piece.verdict is not None and piece.low < number < piece.high:
            now = again.judged(rule, {param: like(params[param], number)})
            assert now == (piece.verdict, piece.at_risk), piece
    so_far, monitor = growing(episode), Monitor(episode.header, found, assigned_only=False)
    for frames in range(6, len(episode) + 1, 6):
        so_far.frames = frames
        monitor.update(so_far, so_far.success_time)
    offline = {v.rule: v for v in judge(episode, found).verdicts}["ETS901"]
    assert (offline.verdict == "violation") == ("ETS901" in monitor.violations)
