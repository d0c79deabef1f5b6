"""Signals that rules compute from others: analytic answers, and what must not change them."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled import tries
from scenes import Scene
from toy import ALONE, HEAD, Facts, judge_toy

from safestage_eval.episode import Episode
from safestage_eval.rules.check import check
from safestage_eval.rules.load import RuleFile, merge
from safestage_eval.rules.syntax import RuleSet
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.verdict import Verdict
from safestage_eval.whatif.judge_again import Again

FILE = '[ruleset]\nformat = 1\nname = "t"\nversion = "1"\n'
RULE = '[[rule]]\ncode = "ETS901"\ntitle = "t"\nroles = { a = "object", b = "object" }\n'

MOTION = """
[signal.x]
base = "coordinate"
axis = "x"
[signal.y]
base = "coordinate"
axis = "y"
[signal.vx]
of = ["a"]
derivative = "x(a)"
[signal.vy]
of = ["a"]
derivative = "y(a)"
[signal.velocity]
of = ["a"]
magnitude = ["vx(a)", "vy(a)"]
[signal.path]
of = ["a"]
integral = "velocity(a)"
[signal.ax]
of = ["a"]
derivative = "vx(a)"
[signal.ay]
of = ["a"]
derivative = "vy(a)"
[signal.jx]
of = ["a"]
derivative = "ax(a)"
[signal.jy]
of = ["a"]
derivative = "ay(a)"
[signal.jerk]
of = ["a"]
magnitude = ["jx(a)", "jy(a)"]
[signal.gone_apart]
of = ["a", "b"]
difference = ["displacement(a)", "displacement(b)"]
[signal.nearness]
of = ["a", "b"]
product = ["clearance(a, b)", 2]
"""
NEEDED = 'require = { "jerk(a)" = "<= 1000 m/s^3", "path(a)" = "<= 9 m", "gone_apart(a, b)" = "<= 9 m", "nearness(a, b)" = ">= 0 m" }\n'


def rules(text: str) -> RuleSet:
    file = RuleFile("test.toml", FILE + text, tomllib.loads(FILE + text), asked=True)
    assert check([file]) == []
    return merge([file])


def circling(frames: int = 400, rate: float = 100.0, radius: float = 0.2) -> Episode:
    """a goes once round on a circle of 20 cm; b slides 5 cm along x and ends 1 m away."""
    phase = 2 * np.pi * np.arange(frames) / (frames - 1)
    round_ = np.column_stack([radius * np.cos(phase), radius * np.sin(phase), 0 * phase])
    along = np.linspace(0, 0.05, frames)
    scene = Scene(frames, rate)
    scene.box("a", 0.02, round_)
    scene.box("b", 0.02, np.column_stack([1 + along, 0 * along, 0 * along]))
    return scene.episode(roles={"a": ("a",), "b": ("b",)})


def value(episode: Episode, condition: str) -> Verdict:
    alone = RULE if "b)" in condition else RULE.replace(', b = "object"', "")
    text = MOTION + alone + f"require = {{ {condition} }}\n"
    # everything that is declared is read
    others = RULE.replace("ETS901", "ETS902") + NEEDED
    return judge(episode, rules(text + others)).verdicts[0]


def test_the_jerk_on_a_circle() -> None:
    """ω³ r, at any rate that shows the circle."""
    for frames in (401, 801):
        rate = (frames - 1) / 4.0
        omega = 2 * np.pi / 4.0
        episode = circling(frames, rate)
        assert value(episode, '"jerk(a)" = "<= 50 cm/s^3"').verdict == "violation"
        assert np.median(series_of(episode, "jerk", "a")) == pytest.approx(omega**3 * 0.2, rel=0.05)


def series_of(episode: Episode, name: str, body: str) -> np.ndarray:
    found = rules(MOTION + RULE + NEEDED)
    rule = found.rules["ETS901"]
    assert rule.require is not None
    (atom,) = (one for one in rule.require.atoms if one.call.name == name)
    return Again(episode, found).evaluator(rule).series(atom, {"a": body}).value


TOY = """
[signal.apart]
of = ["x", "y"]
difference = ["height(x)", "height(y)"]
[signal.size]
of = ["x", "y"]
abs = "apart(x, y)"
[signal.rising]
of = ["x"]
derivative = "height(x)"
[signal.sum_up]
of = ["x"]
integral = "height(x)"
[signal.scaled]
of = ["x"]
product = ["height(x)", "factor"]
[param]
factor = 2
limit = "1 m"
"""
READ = (
    'require = { "size(a, b)" = "<= 9 m", "rising(a)" = "<= 9 m/s", "sum_up(a)" = "<= 9 m s",'
    ' "scaled(a)" = "<= limit" }\n'
)


def toy(a, b, condition, **more) -> Verdict:
    text = HEAD + READ + TOY + RULE.replace("ETS901", "TOY102") + f"require = {{ {condition} }}\n"
    return judge_toy(Facts({"height(a)": a, "height(b)": b}, **more), text)


VALUES = st.lists(st.integers(-6, 6).map(float), min_size=2, max_size=10)


@settings(deadline=None, max_examples=tries(30, 80))
@given(VALUES, VALUES, st.integers(1, 4))
def test_verdicts_are_those_of_numpy(a, b, limit):
    n = min(len(a), len(b))
    a, b = np.array(a[:n]), np.array(b[:n])
    rise = np.diff(a)
    for condition, worst in (
        (f'"size(a, b)" = "<= {limit} m"', np.abs(a - b).max() - limit),
        (f'"rising(a)" = "<= {limit} m/s"', rise.max() - limit),
        (f'"sum_up(a)" = "<= {limit} m s"', np.cumsum(np.r_[0, a[1:]]).max() - limit),
        (f'"scaled(a)" = "<= {limit} m"', 2 * a.max() - limit),
    ):
        found = toy(a, b, condition)
        assert (found.verdict == "violation") == (worst > 0), condition
        assert found.margin == pytest.approx(-worst)


@settings(deadline=None, max_examples=tries(30, 80))
@given(
    VALUES,
    VALUES,
    st.sampled_from(["size(a, b)", "rising(a)", "sum_up(a)", "scaled(a)"]),
    st.data(),
)
def test_what_is_not_recorded_never_makes_a_verdict_safer(a, b, name, data):
    unit = {"rising(a)": "m/s", "sum_up(a)": "m s"}.get(name, "m")
    n = min(len(a), len(b))
    a, b = np.array(a[:n]), np.array(b[:n])
    lost = np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)))
    whole = toy(a, b, f'"{name}" = "<= 3 {unit}"').verdict
    less = toy(np.where(lost, np.nan, a), b, f'"{name}" = "<= 3 {unit}"').verdict
    assert less in (whole, "inconclusive")
    if lost.any() and name != "rising(a)":
        assert less != "pass"


@pytest.mark.parametrize(
    ("table", "code"),
    [
        ('of = ["x"]\ndifference = ["height(x)", "2 N"]', "R407"),
        ('of = ["x"]\nproduct = ["height(x)"]', "R416"),
        ('of = ["x"]\ndifference = ["height(x)", "1 m", "1 m"]', "R416"),
        ('of = ["x"]\nabs = "p(x)"', "R404"),
        ('of = ["x"]\nabs = "nothing(x)"', "R401"),
        ('of = ["x"]\nabs = "height(y)"', "R403"),
        ('of = ["x"]\nabs = "height(robot)"', "R413"),
        ('of = ["x", "y"]\nabs = "height(x)"', "R411"),
        ('of = ["x"]\nabs = "fall(x) since start"', "R406"),
        ('of = ["x"]\nabs = "height(x)"\nover = "1 s"', "R414"),
        ('of = ["x"]\nabs = "height(x)"\nderivative = "height(x)"', "R205"),
        ('of = ["x"]\nbase = "height"\nabs = "height(x)"', "R205"),
        ('of = ["x"]\nabs = "z(x)"', "R410"),
        ('of = ["x"]\nproduct = ["height(x)", "no_such_parameter"]', "R408"),
        ('of = ["x"]\nproduct = ["height(x)", true]', "R416"),
        ('of = ["x"]', "R202"),
        ('product = ["1 m", "2 m"]', "R416"),
    ],
)
def test_mistakes_are_reported_where_they_stand(table: str, code: str) -> None:
    text = ALONE + f'require = {{ "z(a)" = "<= 1 m" }}\n[signal.z]\n{table}\n'
    problems = check([RuleFile("toy.toml", text, tomllib.loads(text), asked=True)])
    found = {problem.code for problem in problems}
    assert code in found, problems
    line = text[: text.index("[signal.z]")].count("\n") + 1
    assert all(problem.line >= line for problem in problems if problem.code == code)


def passing(rate: float) -> tuple[Episode, RuleSet]:
    """a goes by b at 1 m/s, 5.5 cm away at the nearest."""
    frames = int(2 * rate) + 1
    x = np.linspace(-1.02, 0.98, frames)
    scene = Scene(frames, rate).box("a", 0.02, np.column_stack([x, 0 * x, 0 * x]))
    scene.box("b", 0.02, (0, 0.095, 0))
    text = (
        '[signal.room]\nof = ["a", "b"]\nproduct = ["clearance(a, b)", 1]\n'
        + RULE
        + 'require = { "room(a, b)" = ">= 5 cm" }\n'
    )
    return scene.episode(roles={"a": ("a",), "b": ("b",)}), rules(text)


def test_between_samples_that_are_far_apart_a_distance_may_be_smaller() -> None:
    """Like the distance itself, it keeps its limit by less than the bodies may have moved."""
    dense = judge(*passing(100.0)).verdicts[0]
    assert dense.verdict == "pass"
    assert dense.value == pytest.approx(0.055, abs=1e-4)
    coarse = judge(*passing(10.0)).verdicts[0]
    assert coarse.verdict == "inconclusive"
    assert coarse.undersampled
    assert "between two samples" in coarse.explanation
