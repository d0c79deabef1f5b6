"""Which rules the past decides, and how much later, is inferred from their text."""

from __future__ import annotations

import pytest
from toy import HEAD, ruleset

from safestage_eval.monitor import Foresight, foresight
from safestage_eval.rules import builtin_names, load_rules

DT = 0.01
STATES = """
[state.long]
of = ["a"]
when = { "p(a)" = true }
for = "2 s"
gap = "1 s"
[state.deep]
of = ["a"]
when = { "long(a)" = true }
for = "3 s"
[phase.hold]
span = "5 s after success"
[phase.settle]
of = ["a"]
span = "last 1 s of hold"
fallback = "last 1 s of episode while p(a)"
"""


def ahead(obligation: str, *, blind: bool = False) -> Foresight:
    """Foresight of one rule, whose states are declared behind it."""
    rules = ruleset(HEAD + obligation + STATES)
    return foresight(rules, rules.rules["TOY101"], rules.params, DT, blind=blind)


@pytest.mark.parametrize(
    ("obligation", "least", "most"),
    [
        ('require = { "p(a)" = true, "q(b)" = true }', 0, 0),
        ('forbid = { "p(a)" = true, "q(b)" = true }\\nfor = "2 s"', 2, 2.02),
        ('require = { "long(a)" = true, "q(b)" = true }', 3, 3.04),
        ('require = { "deep(a)" = true, "q(b)" = true }', 6, 6.06),
        ('require = { "q(b)" = true }\\nduring = "from start to long(a)"', 3, 3.04),
        ('require = { "q(b)" = true }\\nduring = "episode while long(a)"', 3, 3.04),
        ('require = { "q(b)" = true, "p(a)" = true }\\nduring = "hold"', 0, 0),
        ('require = { "q(b)" = true }\\nat = "end of long(a)"', 3, 3.04),
        ('forbid = { "q(b)" = true }\\nfor = "10 frames"\\nuntil = "long(a)"', 3, 3.04),
        ('require = { "q(b)" = true }\\nduring = "first 1 s of long(a)"', 3, 3.04),
        ('require = { "q(b)" = true }\\nduring = "1 s after start of p(a)"', 0, 0),
        ('require = { "q(b)" = true, "displacement(a) since end of long(a)" = "<= 1 m" }', 3, 3.04),
    ],
)  # fmt: skip
def test_the_past_decides_a_bounded_time_later(obligation: str, least: float, most: float) -> None:
    found = ahead(obligation.replace("\\n", "\n"))
    assert found.causal
    assert least <= found.seconds <= most


@pytest.mark.parametrize(
    ("obligation", "awaits"),
    [
        ('require = { "q(b)" = true }\nduring = "settle(a)"', "the end of the phase hold"),
        ('require = { "q(b)" = true, "p(a)" = true }\nduring = "last 1 s of episode"', "the end of the episode"),
        ('require = { "q(b)" = true, "p(a)" = true }\nat = "end"', "the end of the episode"),
        ('require = { "q(b)" = true }\nduring = "1 s before start of p(a)"', "start of p(a)"),
        ('reach = { "q(b)" = true, "p(a)" = true }', "the end of the episode"),
        ('reach = { "q(b)" = true, "p(a)" = true }\nduring = "hold"', "must be reached"),
    ],
)  # fmt: skip
def test_what_needs_the_future_is_named_with_what_it_waits_for(
    obligation: str, awaits: str
) -> None:
    found = ahead(obligation)
    assert not found.causal
    assert awaits in found.awaits


def test_the_built_in_rules() -> None:
    rules = load_rules(builtin_names())
    looks = {
        code: foresight(rules, rule, rules.params, 1 / 120) for code, rule in rules.rules.items()
    }
    waiting = {code for code, look in looks.items() if not look.causal}
    assert waiting == {"FSH101", "FSH102", "FSH103", "FSH106", "FSH201", "FSH203", "FSH204"}
    seconds = {code: look.seconds for code, look in looks.items() if look.causal}
    frame = 1 / 120
    touched = 0.5 + 6 * frame  # a brief touch counts by what it does within half a second
    bound = touched + 4 * frame  # what the hand has is bound to the target while the two touch
    freed = bound + 0.1 + frame  # no longer bound for a tenth of a second
    came_out = freed + 0.1 + frame  # for a tenth of a second, before it was freed
    borne = bound + 0.5 + frame  # what leaves its support may be back within half a second
    lost = borne + 0.1 + frame  # slid off for a tenth of a second
    for code, later in seconds.items():
        if code.startswith("ISH"):
            assert later == pytest.approx(came_out if code == "ISH203" else lost), code
        else:
            assert later <= touched + 1e-9, code


def test_without_forces_a_grip_is_inferred_from_the_whole_motion() -> None:
    rules = load_rules(builtin_names())
    for code, causal in (("ETS104", True), ("ISH203", False)):
        look = foresight(rules, rules.rules[code], rules.params, 1 / 120, blind=True)
        assert look.causal == causal
