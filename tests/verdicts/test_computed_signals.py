"""Signals that rules compute from others: analytic answers, and what must not change them."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from growing import growing
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import Scene
from toy import ALONE, HEAD, Facts, judge_toy, ruleset

from safestage_eval.episode import Episode
from safestage_eval.errors import InputError
from safestage_eval.monitor import Monitor
from safestage_eval.report.rule_report import explain_rule, rule_facts
from safestage_eval.rules.check import check
from safestage_eval.rules.digest import rule_digest
from safestage_eval.rules.load import RuleFile, merge
from safestage_eval.rules.syntax import Quantity, RuleSet
from safestage_eval.rules.uses import own_params, uses_of
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.ask import ask
from safestage_eval.verdicts.verdict import Verdict
from safestage_eval.whatif.flips import pieces_of
from safestage_eval.whatif.judge_again import Again
from safestage_eval.whatif.mutants import mutants_in

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
[signal.nearest_of_two]
of = ["a", "b"]
min = ["clearance(a, b)", "1 m"]
"""
NEEDED = 'require = { "jerk(a)" = "<= 1000 m/s^3", "path(a)" = "<= 9 m", "gone_apart(a, b)" = "<= 9 m", "nearest_of_two(a, b)" = ">= 0 m" }\n'


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


def test_the_path_round_a_circle_is_its_circumference() -> None:
    found = value(circling(), '"path(a)" = "<= 1 m"')
    assert found.verdict == "violation"
    assert found.value == pytest.approx(2 * np.pi * 0.2, rel=1e-4)
    assert (found.dimension, found.signal) == ("length", "path(a)")


def test_the_path_is_the_sum_of_all_steps() -> None:
    rng = np.random.default_rng(2)
    place = np.cumsum(rng.normal(0, 0.01, (80, 3)) * [1, 1, 0], axis=0)
    scene = Scene(80).box("a", 0.02, place).box("b", 0.02, (3, 0, 0))
    steps = np.linalg.norm(np.diff(place, axis=0), axis=1).sum()
    found = value(scene.episode(roles={"a": ("a",), "b": ("b",)}), '"path(a)" = "<= 1 mm"')
    assert found.value == pytest.approx(steps, rel=1e-4)


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
    return Again(episode, found).base(rule)[0].series(atom, {"a": body}).value


def test_two_signals_are_compared() -> None:
    """a comes back, b does not: in the end b has gone 5 cm further."""
    assert value(circling(), '"gone_apart(a, b)" = ">= -4 cm"').verdict == "violation"
    assert value(circling(), '"gone_apart(a, b)" = ">= -6 cm"').verdict == "pass"


def test_a_distance_is_exact_however_far_it_is() -> None:
    """Not only as far as a limit asks: what is computed from it may ask for any of it."""
    found = value(circling(), '"nearest_of_two(a, b)" = ">= 2 m"')
    assert found.value == pytest.approx(0.76, abs=1e-3)


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


@settings(deadline=None, max_examples=80)
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


@settings(deadline=None, max_examples=80)
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


@settings(deadline=None, max_examples=60)
@given(VALUES, st.integers(2, 4))
def test_a_staircase_adds_up_alike_at_any_rate(a, times):
    """Each value held for so many samples: ends of stairs are at the same times."""
    first = toy(np.repeat(a, 2), np.zeros(2 * len(a)), '"sum_up(a)" = "<= 1 m s"', rate=2.0)
    dense = toy(np.repeat(a, 2 * times), np.zeros(2 * times * len(a)), '"sum_up(a)" = "<= 1 m s"',
                rate=2.0 * times)  # fmt: skip
    slack = max(map(abs, a))  # of the first sample, before which nothing is added
    assert abs(first.value - dense.value) <= slack


def test_raising_a_limit_never_adds_a_violation() -> None:
    rng = np.random.default_rng(5)
    for _ in range(30):
        a, b = rng.integers(-5, 6, (2, 8)).astype(float)
        verdicts = [toy(a, b, f'"size(a, b)" = "<= {k} m"').verdict for k in range(1, 8)]
        assert verdicts == sorted(verdicts, key=["violation", "pass"].index)


@pytest.mark.parametrize(
    ("table", "code"),
    [
        ('of = ["x"]\nsum = ["height(x)", "2 N"]', "R407"),
        ('of = ["x"]\nsum = ["height(x)"]', "R416"),
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
        ('of = ["x"]\nsum = ["height(x)", "no_such_parameter"]', "R408"),
        ('of = ["x"]\nsum = ["height(x)", true]', "R416"),
        ('of = ["x"]', "R202"),
        ('sum = ["1 m", "2 m"]', "R416"),
    ],
)
def test_mistakes_are_reported_where_they_stand(table: str, code: str) -> None:
    text = ALONE + f'require = {{ "z(a)" = "<= 1 m" }}\n[signal.z]\n{table}\n'
    problems = check([RuleFile("toy.toml", text, tomllib.loads(text), asked=True)])
    found = {problem.code for problem in problems}
    assert code in found, problems
    line = text[: text.index("[signal.z]")].count("\n") + 1
    assert all(problem.line >= line for problem in problems if problem.code == code)


def test_a_group_goes_through_to_what_takes_it() -> None:
    text = ALONE + (
        'require = { "z(robot, a)" = "<= 1 N", "p(a)" = true, "q(a)" = true }\n'
        '[signal.z]\nof = ["x", "y"]\nmax = ["contact_force(x, y)", "1 mN"]\n'
    )
    assert check([RuleFile("toy.toml", text, tomllib.loads(text), asked=True)]) == []


def test_a_digest_reaches_through_and_uses_are_reported() -> None:
    found = ruleset(HEAD + READ + TOY)
    rule = found.rules["TOY101"]
    other = ruleset(
        (HEAD + READ + TOY).replace('"height(x)", "height(y)"', '"height(y)", "height(x)"')
    )
    params = own_params(found, rule)
    assert rule_digest(found, rule, params) != rule_digest(other, other.rules["TOY101"], params)
    twice = {**params, "factor": Quantity(3.0, "ratio")}
    assert rule_digest(found, rule, params) != rule_digest(found, rule, twice)
    uses = uses_of(found, rule, params)
    assert uses.signals == ("height",)
    assert set(uses.computed) == {"size", "apart", "rising", "sum_up", "scaled"}
    said = explain_rule(rule_facts(found, rule, {}))
    assert "apart(x, y)" in said
    assert "difference of height(x) and height(y)" in said
    assert "factor" in uses.params
    assert uses.needs == ("poses",)


def test_mutants_change_operation_order_constant_and_operand() -> None:
    found = ruleset(HEAD + READ + TOY)
    said = {name: " ".join(m.what for m in mutants_in(found, name)) for name in found.derived}
    assert "→ sum of height(x) and height(y)" in said["apart"]
    assert "→ difference of height(y) and height(x)" in said["apart"]
    assert "20" in said["scaled"]


def moving_up() -> tuple[Episode, RuleSet]:
    z = np.r_[np.zeros(30), np.linspace(0, 0.3, 60), np.full(30, 0.3)]
    place = np.column_stack([0 * z, 0 * z, z])
    scene = Scene(120).box("a", 0.02, place).box("b", 0.02, (1, 0, 0))
    text = (
        '[param]\nhighest = "10 cm"\n[signal.up]\nof = ["a"]\nderivative = "height(a)"\n'
        '[signal.way]\nof = ["a"]\nintegral = "up(a)"\n'
        + RULE.replace(', b = "object"', "")
        + 'require = { "way(a)" = "<= highest" }\n'
    )
    return scene.episode(roles={"a": ("a",)}), rules(text)


def test_flip_values_say_what_judging_says() -> None:
    episode, found = moving_up()
    again = Again(episode, found)
    rule = found.rules["ETS901"]
    pieces = pieces_of(again.base(rule)[0], rule, {"a": ("a",)}, "highest", 1.0)
    assert [p.verdict for p in pieces[:2]] == ["violation", "pass"]
    assert pieces[0].high == pytest.approx(0.3, abs=1e-5)
    for piece in pieces[:2]:
        value = min((piece.low + min(piece.high, 1.0)) / 2, 0.9)
        again_ = again.under(again.base(rule)[0], rule, {"highest": Quantity(value, "length")})
        assert again_.verdict == piece.verdict


def test_the_monitor_tells_it_as_it_goes_on() -> None:
    episode, found = moving_up()
    so_far = growing(episode)
    monitor = Monitor(episode.header, found, assigned_only=False)
    when = None
    for frames in range(5, 121, 5):
        so_far.frames = frames
        new = monitor.update(so_far, so_far.success_time)
        offline = judge(so_far.up_to_now(), found).verdicts[0].verdict == "violation"
        assert offline == bool(monitor.violations)
        if new and when is None:
            when = new[0].time
    assert when == judge(episode, found).verdicts[0].time


def passing(rate: float) -> tuple[Episode, RuleSet]:
    """a goes by b at 1 m/s, 5.5 cm away at the nearest."""
    frames = int(2 * rate) + 1
    x = np.linspace(-1.02, 0.98, frames)
    scene = Scene(frames, rate).box("a", 0.02, np.column_stack([x, 0 * x, 0 * x]))
    scene.box("b", 0.02, (0, 0.095, 0))
    text = (
        '[signal.room]\nof = ["a", "b"]\nmin = ["clearance(a, b)", "1 m"]\n'
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


def test_what_is_not_known_is_reported_with_its_cause() -> None:
    found = toy(np.array([1, np.nan, 2, 1]), np.zeros(4), '"sum_up(a)" = "<= 9 m s"')
    assert found.verdict == "inconclusive"
    assert "what sum_up() adds up is not known from 1.00 s on" in found.explanation


def test_a_ball_has_no_tilt_to_compute_with() -> None:
    """It is not judged by what is computed from one, whichever way the limit lies."""
    scene = Scene(10).box("a", 0.02, (0, 0, 0.02), up_axis=None).box("b", 0.02, (1, 0, 0.02))
    episode = scene.episode(roles={"a": ("a",)})
    for limit in (">= 90 deg", "<= 1 deg"):
        text = '[signal.lean]\nof = ["a"]\nabs = "tilt(a)"\n' + RULE.replace(', b = "object"', "")
        text += f'require = {{ "lean(a)" = "{limit}" }}\n'
        (found,) = judge(episode, rules(text)).verdicts
        assert found.verdict == "pass"
        assert any("no up axis" in note for note in found.notes)


def test_names_of_bodies_and_formal_arguments_change_nothing() -> None:
    one = toy([1.0, 4.0], [2.0, 1.0], '"size(a, b)" = "<= 2 m"')
    text = (HEAD + READ + TOY).replace('of = ["x", "y"]\ndifference = ["height(x)", "height(y)"]',
                                       'of = ["q", "r"]\ndifference = ["height(q)", "height(r)"]')  # fmt: skip
    text += RULE.replace("ETS901", "TOY102") + 'require = { "size(a, b)" = "<= 2 m" }\n'
    facts = Facts({"height(p1)": [1.0, 4.0], "height(p2)": [2.0, 1.0]})
    other = judge_toy(facts, text, {"a": ("p1",), "b": ("p2",)})
    assert (one.verdict, one.value, one.time) == (other.verdict, other.value, other.time)
    assert other.signal == "size(p1, p2)"


def test_a_declared_signal_can_be_asked_for_by_name() -> None:
    """Computed ones and variants, as rules would measure them."""
    episode, declared = circling(), rules(MOTION + RULE + NEEDED)
    path = ask(episode, "path(a)", None, declared)
    assert path.lower[-1] == pytest.approx(2 * np.pi * 0.2, rel=1e-4)
    assert path.dimension == "length"
    assert ask(episode, "x(b)", None, declared).lower == pytest.approx(np.linspace(1, 1.05, 400))
    for wrong in ("path(a, b)", "x(a, b)", "paths(a)"):
        with pytest.raises(InputError):
            ask(episode, wrong, None, declared)
