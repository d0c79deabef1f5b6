"""States as they were, and pairs of states, in rules: verdicts, causes, flips, the monitor, mistakes."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from growing import growing
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import Scene
from toy import HEAD, Facts, judge_toy, series

from safestage_eval.monitor import Monitor
from safestage_eval.rules.check import check
from safestage_eval.rules.load import RuleFile, merge
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.verdict import Verdict
from safestage_eval.whatif.judge_again import Again
from safestage_eval.whatif.value_ranges import all_pieces


def judged(p: str, q: str, condition: str, rate: float = 1.0) -> Verdict:
    facts = Facts({"height(a)": series(p), "height(b)": series(q)}, rate=rate)
    text = f'{HEAD}given = {{ any = ["p(a)", {{ "p(a)" = false }}, "q(b)"] }}\n{condition}\n'
    return judge_toy(facts, text)


@pytest.mark.parametrize(
    ("p", "q", "key", "verdict"),
    [
        ("0100000", "0000000", "once[0 s, 5 s] p(a)", "violation"),  # not yet at the first sample
        ("1000000", "0000000", "once[0 s, 6 s] p(a)", "pass"),
        ("1000000", "0000000", "once[0 s, 5 s] p(a)", "violation"),
        ("1000000", "0000000", "once p(a)", "pass"),
        ("1000000", "0000000", "once[0 s] p(a)", "pass"),
        ("1110000", "0000000", "once[2 s, 4 s] p(a)", "violation"),  # at 0 s there was nothing
        ("1111111", "0000000", "always p(a)", "pass"),
        ("1101111", "0000000", "always[0 s, 1 s] p(a)", "violation"),
        ("0011111", "1000000", "p(a) since[0 s] q(b)", "violation"),  # p was out at 1 s
        ("0111111", "1000000", "p(a) since[0 s] q(b)", "pass"),
        (
            "0111111",
            "1000000",
            "p(a) since[0 s, 3 s] q(b)",
            "violation",
        ),  # q is too long ago at 4 s
        ("0101010", "0101010", "p(a) iff q(b)", "pass"),
        ("0101010", "0101110", "p(a) iff q(b)", "violation"),
        ("0101010", "1010101", "p(a) xor q(b)", "pass"),
        ("0101010", "1010111", "p(a) xor q(b)", "violation"),
    ],
)
def test_truth_table(p: str, q: str, key: str, verdict: str) -> None:
    assert judged(p, q, f'require = {{ "{key}" = true }}').verdict == verdict
    opposite = judged(p, q, f'forbid = {{ "{key}" = false }}')
    assert opposite.verdict == verdict


@pytest.mark.parametrize(
    ("p", "q", "key", "verdict"),
    [
        ("0?000", "00000", "once[0 s, 1 s] p(a)", "inconclusive"),
        ("1?000", "00000", "once p(a)", "violation"),
        ("00?11", "00000", "always[1 s, 2 s] p(a)", "violation"),
        ("11?11", "00000", "always p(a)", "inconclusive"),
        ("1111?", "10000", "p(a) since[0 s] q(b)", "inconclusive"),
        ("0011?", "1100?", "p(a) xor q(b)", "inconclusive"),
    ],
)
def test_what_is_unknown(p: str, q: str, key: str, verdict: str) -> None:
    """Forbidden: it breaks where it certainly holds, passes where it certainly never does."""
    wanted = key.startswith("always") or " " in key.partition("(a)")[2]
    rule = f'require = {{ "{key}" = true }}' if wanted else f'forbid = {{ "{key}" = true }}'
    found = judged(p, q, rule)
    if verdict == "violation" and wanted:
        found = judged(p, q, f'require = {{ "{key}" = true }}')
    assert found.verdict == verdict
    if verdict == "inconclusive":
        assert "height" in found.explanation


TRUTH = st.text("01?", min_size=1, max_size=8)
KEYS = st.sampled_from(
    ["once p(a)", "once[1 s, 3 s] p(a)", "always[0 s, 2 s] p(a)", "p(a) since[0 s, 3 s] q(b)",
     "p(a) since[1 s] q(b)", "p(a) iff q(b)", "p(a) xor q(b)"]
)  # fmt: skip


@settings(deadline=None, max_examples=150)
@given(
    TRUTH, TRUTH, KEYS, st.booleans(), st.sampled_from(["require", "forbid", "reach"]), st.data()
)
def test_what_was_not_seen_never_makes_a_verdict_safer(p, q, key, want, kind, data):
    n = min(len(p), len(q))
    p, q = p[:n].replace("?", "0"), q[:n].replace("?", "1")
    lost = data.draw(st.lists(st.booleans(), min_size=n, max_size=n))
    less = "".join("?" if gone else c for c, gone in zip(p, lost, strict=True))
    rule = f'{kind} = {{ "{key}" = {str(want).lower()} }}'
    whole = judged(p, q, rule).verdict
    assert whole in ("pass", "violation")
    assert judged(less, q, rule).verdict in (whole, "inconclusive")


@settings(deadline=None, max_examples=100)
@given(TRUTH, TRUTH, KEYS, st.booleans(), st.sampled_from(["require", "forbid", "reach"]))
def test_the_witness_is_a_measurement_with_the_margin(p, q, key, want, kind):
    """Heights are ±1 m and their limit 0, of which 1 cm counts as one."""
    n = min(len(p), len(q))
    p, q = p[:n].replace("?", "0"), q[:n].replace("?", "1")
    found = judged(p, q, f'{kind} = {{ "{key}" = {str(want).lower()} }}')
    if found.margin_normalised is not None and np.isfinite(found.margin_normalised):
        assert found.margin == pytest.approx(found.margin_normalised * 0.01)
        assert (found.margin < 0) == (found.verdict == "violation")
        assert found.signal in ("height(a)", "height(b)")
        at = round(found.worst_time)
        assert found.value == {"0": -1.0, "1": 1.0}[(p if found.signal == "height(a)" else q)[at]]


@pytest.mark.parametrize(
    ("key", "value", "code"),
    [
        ("once[2 s, 1 s] p(a)", "true", "R307"),
        ("once[2 N, 3 s] p(a)", "true", "R307"),
        ("once height(a)", "true", "R404"),
        ("once[0 s, limit] p(a)", "true", "R407"),
        ("once[0 s, nothing] p(a)", "true", "R408"),
        ("always[0 s, 1 s] p(c)", "true", "R403"),
        ("p(a) since[0 s] r(b)", "true", "R401"),
        ("p(a) since[0 s] q(a, b)", "true", "R402"),
        ("p(a) iff height(b)", "true", "R404"),
        ("p(a) xor q(b)", '"at least 1 a"', "R405"),
        ("p(a) iff", "true", "R307"),
        ("once[0 s, 1 s, 2 s] p(a)", "true", "R307"),
    ],
)
def test_mistakes_are_reported_where_they_stand(key: str, value: str, code: str) -> None:
    head = HEAD.replace("[[rule]]", '[param]\nlimit = "3 m"\n[[rule]]')
    text = f'{head}require = {{ "p(a)" = true, "q(b)" = true, "{key}" = {value} }}\n'
    problems = check([RuleFile("toy.toml", text, tomllib.loads(text), asked=True)])
    found = [p for p in problems if p.code == code]
    assert found, problems
    assert found[0].line == text.count("\n")
    assert key.split("[", maxsplit=1)[0].split(" ", maxsplit=1)[0] in found[0].source


FILE = """
[ruleset]
format = 1
name = "t"
version = "1"
[param]
height_limit = "10 cm"
[state.up]
of = ["a"]
when = { "height(a)" = ">= height_limit" }
[[rule]]
code = "ETS901"
title = "t"
roles = { a = "object" }
forbid = { "once[0.2 s, 0.4 s] up(a)" = true }
"""


def hop():
    """a is lifted to 20 cm for a tenth of a second, at 0.5 s."""
    z = np.where((np.arange(240) >= 60) & (np.arange(240) < 72), 0.2, 0.0)
    scene = Scene(240).box("a", 0.02, np.column_stack([0 * z, 0 * z, z]))
    text = FILE
    rules = merge([RuleFile("t.toml", text, tomllib.loads(text), asked=True)])
    return scene.episode(roles={"a": ("a",)}), rules


def test_it_is_violated_when_that_was_so_long_ago() -> None:
    episode, rules = hop()
    (found,) = judge(episode, rules).verdicts
    assert found.verdict == "violation"
    assert found.time == pytest.approx(0.7, abs=1 / 120)
    assert found.intervals[-1][1] == pytest.approx(0.6 + 0.4, abs=2 / 120)
    assert found.value == pytest.approx(0.2)


def test_flip_values_say_what_judging_says() -> None:
    episode, rules = hop()
    again, rule = Again(episode, rules), rules.rules["ETS901"]
    pieces = all_pieces(again, rule, ["height_limit"], 1.0)["height_limit"]
    assert [p.verdict for p in pieces[:2]] == ["violation", "pass"]
    assert pieces[0].high == pytest.approx(0.2, abs=1e-6)


def test_the_monitor_tells_it_as_it_goes_on() -> None:
    episode, rules = hop()
    so_far, when = growing(episode), None
    monitor = Monitor(episode.header, rules, assigned_only=False)
    for frames in range(24, 241, 24):
        so_far.frames = frames
        new = monitor.update(so_far, so_far.success_time)
        offline = judge(so_far.up_to_now(), rules).verdicts[0].verdict == "violation"
        assert offline == bool(monitor.violations)
        if new:
            when = so_far.up_to_now().t[-1], new[0].time
    assert when is not None
    assert when[1] == judge(episode, rules).verdicts[0].time
    assert when[0] <= when[1] + 25 / 120
