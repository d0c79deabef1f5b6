"""Costs: sums, budgets, what is not known, and what a result says of them."""

import json
import math
import tomllib
from pathlib import Path

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import Scene
from toy import Facts, cost_toy, series

from safestage_eval.report import render
from safestage_eval.report.episode_report import explain
from safestage_eval.report.result_schema import row_schema
from safestage_eval.rules import RuleSet, check_rules
from safestage_eval.rules.files import RuleFile
from safestage_eval.rules.load import merge
from safestage_eval.run.scores import Scores
from safestage_eval.verdicts import judge

HEAD = '[[cost]]\ncode = "TOY201"\ntitle = "toy"\nroles = { a = "object" }\n'
FILE = '[ruleset]\nformat = 1\nname = "toy"\nversion = "1"\n[param]\npatience = 2\nfar = "1 m"\n'
TIME_UP = 'charge = [{ when = { "height(a)" = ">= far" }, add = 10, per = "second" }]\n'


def total(p: str, charge: str, more: str = "", **options):
    facts = Facts({"height(a)": series(p)}, rate=10.0, **options)
    return cost_toy(facts, HEAD + f"charge = [{charge}]\n{more}")


def when(per: str, add: float = 1) -> str:
    return f'{{ when = "p(a)", add = {add}, per = "{per}" }}'


@pytest.mark.parametrize(
    ("p", "per", "value", "most"),
    [
        ("0110100", "start", 2, 2),
        ("1110011", "start", 2, 2),  # what is there at the first frame starts there
        ("0110100", "second", 0.3, 0.3),
        ("0110100", "step", 3, 3),  # the policy's steps are not known: frames
        ("0?10100", "start", 2, 2),
        ("0??1000", "start", 1, 2),  # 0001 or 0101
        ("?", "start", 0, 1),
        ("?????", "start", 0, 3),
        ("1?1", "start", 1, 2),
        ("0?10?00", "second", 0.1, 0.3),
    ],
)
def test_sums(p: str, per: str, value: float, most: float) -> None:
    found, verdict = total(p, when(per))
    assert (found.value, found.most) == (pytest.approx(value), pytest.approx(most))
    assert found.budget is None
    assert verdict is None


def test_a_step_is_one_of_the_policys() -> None:
    """Eight frames at 10 Hz are four steps of 0.2 s; at any rate of recording the same."""
    found, _ = total("0011111111", when("step"), control_dt=0.2)
    assert found.value == pytest.approx(4)


def amount(values, charge, head="", **params):
    facts = Facts({"height(a)": values}, rate=10.0)
    found, _ = cost_toy(facts, f"{head}{HEAD}charge = [{charge}]\n", **params)
    return found


@given(st.lists(st.integers(-5, 5).map(float), min_size=1, max_size=9), st.integers(-3, 3))
def test_amounts_beyond_and_short_of_a_limit(values, limit) -> None:
    """Excess and deficit are plain sums over the frames."""
    of = 'of = "height(a)", add = 2, per = "step"'
    above = amount(values, f'{{ {of}, above = "{limit} m" }}').value
    below = amount(values, f'{{ {of}, below = "{limit} m" }}').value
    assert above == pytest.approx(2 * sum(max(v - limit, 0) for v in values))
    assert below == pytest.approx(2 * sum(max(limit - v, 0) for v in values))


@given(
    st.lists(st.integers(-5, 5).map(float), min_size=1, max_size=9),
    st.sampled_from(['above = "1 m"', 'below = "1 m"']),
    st.data(),
)
def test_what_is_not_known_may_be_any_amount(values, limit, data) -> None:
    lost = [data.draw(st.booleans()) for _ in values]
    charge = f'{{ of = "height(a)", add = 2, per = "second", {limit} }}'
    whole = amount(values, charge)
    less = amount([math.nan if gone else v for v, gone in zip(values, lost, strict=True)], charge)
    assert less.value <= whole.value
    assert less.most is None if any(lost) else less.most == whole.most


def judged_once(values, scope: str):
    facts = Facts({"height(a)": values}, rate=10.0)
    charge = 'charge = [{ of = "height(a)", add = 2, per = "start" }]\n'
    return cost_toy(facts, f"{HEAD}{scope}\n{charge}")[0]


def test_an_amount_per_start_is_that_of_the_first_frame() -> None:
    """A start is charged once for each stretch that is judged."""
    values = [1.0, -1.0, 4.0, 8.0, 16.0]  # p(a) holds where it is positive
    for scope, found in (
        ('during = "episode"', 2),
        ('during = "last 1 frames of episode"', 32),
        ('at = "p(a)"', 2 + 8),
        ('during = "p(a)"', 2 + 8),
        ('until = "start"', 0),
    ):
        assert judged_once(values, scope).value == found
    unknown = judged_once([1.0, -1.0, 4.0, 8.0, math.nan], 'during = "last 1 frames of episode"')
    assert (unknown.value, unknown.most) == (0, None)


def test_each_contact_point_is_charged() -> None:
    """Four corners for 6 frames, then two; a point without a force does not count."""
    scene = Scene(10, 10.0).fixed("table").box("a", 0.05, (0, 0, 0.05))
    scene.rests("a", "table", 0.05, (0, 0, 0), 9.81, frames=slice(0, 6))
    scene.contact("table", "a", [[0.05, 0, 0], [-0.05, 0, 0]], (0, 0, 9.81), frames=slice(6, 9))
    scene.contact("table", "a", [[0.05, 0, 0]], (0, 0, 0), frames=slice(6, 10))
    text = FILE.replace('[param]\npatience = 2\nfar = "1 m"\n', "") + (
        '[[cost]]\ncode = "TOY201"\ntitle = "t"\nroles = { a = "object", b = "fixture" }\n'
        'charge = [{ of = "contact_count(a, b)", add = 1, per = "step" }]\n'
    )
    rules = merge([RuleFile("toy.toml", text, tomllib.loads(text), asked=True)])
    (found,) = judge(scene.episode(roles={"a": ("a",), "b": ("table",)}), rules).costs
    assert (found.value, found.most) == (6 * 4 + 3 * 2, 6 * 4 + 3 * 2)


@given(
    st.lists(st.sampled_from("01"), min_size=1, max_size=12),
    st.sampled_from(["first", "last"]),
    st.integers(1, 12),
    st.data(),
)
def test_bounds_hold_whatever_the_unknown_turns_out_to_be(p, which, frames, data) -> None:
    hidden = "".join(data.draw(st.sampled_from([c, c, "?"])) for c in p)
    for per in ("start", "second", "step"):
        span = f'during = "{which} {frames} frames of episode"'
        exact = total("".join(p), when(per, 2), span)[0]
        bounds = total(hidden, when(per, 2), span)[0]
        assert bounds.value <= exact.value + 1e-9
        assert exact.value <= bounds.most + 1e-9
        assert exact.most == exact.value


@pytest.mark.parametrize(
    ("p", "budget", "verdict", "time"),
    [
        ("0101010", 3, "pass", None),
        ("0101010", 2, "violation", 0.5),
        ("0101010", 0, "violation", 0.1),
        ("0000000", 0, "pass", None),
        ("01?1000", 1, "inconclusive", None),
        ("01?1000", 0, "violation", 0.1),
        ("01?1000", 2, "pass", None),
    ],
)
def test_a_budget_makes_a_verdict(p, budget, verdict, time) -> None:
    found = total(p, when("start"), f"budget = {budget}")[1]
    assert (found.verdict, found.time) == (verdict, None if time is None else pytest.approx(time))
    if verdict == "violation":
        assert found.margin == budget - found.value < 0
        assert found.intervals == ((pytest.approx(time), pytest.approx(0.7)),)
        assert f"exceeded its budget of {budget}" in found.explanation
    if verdict == "inconclusive":
        assert "Cannot be decided" in found.explanation


def test_a_truncated_trace_may_have_cost_more() -> None:
    assert total("0100", when("start"), "budget = 1", truncated=True)[1].verdict == "inconclusive"
    assert total("0101", when("start"), "budget = 1", truncated=True)[1].verdict == "violation"
    assert total("0100", when("start"), truncated=True)[0].most is None


def test_many_small_charges_do_not_exceed_a_budget_by_rounding() -> None:
    for frames in range(1, 300):
        found = total("1" * frames, when("second", 0.1), f"budget = {frames / 100:.2f}")[1]
        assert found.verdict == "pass", frames


# ---- as part of a rule set


def ruleset(*costs: str) -> RuleSet:
    text = FILE + "".join(costs)
    return merge([RuleFile("toy.toml", text, tomllib.loads(text), asked=True)])


def lifted(frames: int = 20):
    """Over 1 m in the second half of 2 s."""
    height = [0.5 if i < frames // 2 else 1.5 for i in range(frames)]
    at = [(0, 0, z) for z in height]
    scene = Scene(frames, 10.0).fixed("table").box("mug", 0.05, at)
    return scene.episode(roles={"a": ("mug",)}, rules=("TOY201",))


def test_a_cost_without_a_budget_is_reported_and_decides_nothing() -> None:
    result = judge(lifted(), ruleset(HEAD + TIME_UP))
    assert result.verdicts == ()
    assert result.violation is None
    assert result.not_loaded == ()
    (cost,) = result.costs
    assert cost.value == pytest.approx(10)
    (row,) = result.rows()
    assert (row["rule"], row["verdict"], row["violation"]) == ("TOY201", None, None)
    assert row["value"] == pytest.approx(10)
    assert (row["unit"], row["limit"]) == (None, None)
    jsonschema.validate(json.loads(json.dumps(row)), row_schema())
    assert "The cost came to 10" in explain(result)
    for form in ("csv", "jsonl", "json", "parquet", "table", "junit", "markdown", "github"):
        out = render(Scores((result,), rules={"TOY201": "toy"}), form)
        named = b"TOY201" in (out if isinstance(out, bytes) else out.encode())
        assert named == (form in ("csv", "jsonl", "json", "parquet")), "only rows tell of it"


def test_a_budget_decides_with_severity_limit_and_digest() -> None:
    rules = ruleset(
        HEAD + TIME_UP + "budget = 'patience'\nseverity = { bad = { patience = 9 }, "
        "awful = { patience = 11 } }\n"
        'explain = "{a} cost {value}, not {limit}, from {time} on."\n'
    )
    result = judge(lifted(), rules)
    (verdict,) = result.verdicts
    assert result.violation is True
    assert (verdict.verdict, verdict.severity) == ("violation", "bad")
    assert (verdict.value, verdict.limit) == (pytest.approx(10), 2)
    assert verdict.time == pytest.approx(1.2)
    assert verdict.explanation == "mug cost 10.000, not 2.000, from 1.20 s on."
    (row,) = result.rows()
    assert row["verdict"] == "violation"
    assert (row["value"], row["limit"], row["unit"]) == (pytest.approx(10), 2, None)
    loose = judge(lifted(), rules, overrides={"patience": "12"})
    assert loose.violation is False
    assert loose.verdicts[0].rule_digest != verdict.rule_digest


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        (("add = 10", "add = -1"), "R203", "adds to the cost"),
        (('per = "second"', 'per = "frame"'), "R203", "per"),
        (("charge = [", "charge = []\nbudget = [", ), "R203", "charges nothing"),
        (("\nrequire", "\nbudget = '2 cm'"), "R407", "a length"),
        (("\nrequire", "\nbudget = 'far'"), "R407", "far"),
        (("\nrequire", "\nbudget = -2"), "R301", "never negative"),
        (("\nrequire", "\nbudget = 'pateince'"), "R408", "patience"),
        (("\nrequire", "\nseverity = { bad = { patience = 3 } }"), "R412", "never reads"),
    ],
)  # fmt: skip
def test_mistakes_are_shown(change, code, words, tmp_path: Path) -> None:
    old, new = change
    text = FILE + HEAD + TIME_UP + "\nrequire"
    if old != "\nrequire":
        text = text.replace("\nrequire", "").replace(old, new)
    else:
        text = text.replace(old, new)
    file = tmp_path / "cost.toml"
    file.write_text(text, "utf-8")
    found = check_rules([file])
    assert [d for d in found if d.code == code and words in d.render()], [d.render() for d in found]
