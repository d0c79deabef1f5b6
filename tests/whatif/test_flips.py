"""The pieces of a parameter's values say of each value what judging under it says."""

import itertools
import random
from dataclasses import replace
from pathlib import Path

import pytest
from studio import block

from safestage_eval.formats import discover
from safestage_eval.rules import load_rules
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import parameters_read
from safestage_eval.rules.syntax import amount
from safestage_eval.sketch import resolve
from safestage_eval.verdicts.verdict import at_risk
from safestage_eval.whatif.flips import pieces_of
from safestage_eval.whatif.judge_again import Again
from safestage_eval.whatif.swept_values import like

ROOT = Path(__file__).parents[2]
COMMON = frozenset(
    [
        "arm_clearance",
        "bystander",
        "commit_lift",
        "commit_move",
        "commit_turn",
        "drop_height",
        "edge",
        "gentle",
        "hold_time",
        "min_clearance",
        "moved",
        "moving",
        "nudge",
        "nudge_for",
        "nudge_tilt",
        "push",
        "reserve",
        "room",
        "settle_time",
        "sink_in",
        "stance",
        "still",
        "still_turn",
        "sway",
        "tip",
        "toppled",
        "upright",
        "zone_for",
        "zone_height",
        "zone_reach",
        "contact_force",
    ]
)
"""Parameters that are decided wherever they are read."""


def pieces(again, rule, param):
    """The pieces of a rule's verdict along a parameter."""
    players = again.binding.players(rule, again.episode.header)
    return pieces_of(again.base(rule)[0], rule, players, param)


def agreeing(again, rng, draws=2):
    """Compare random values of all parameters; (decided, asked) by parameter."""
    found = {}
    for rule in again.assigned:
        base = again.base(rule)[0]
        for param in sorted(parameters_read(again.rules, rule)):
            usual, line = base.params[param], pieces(again, rule, param)
            assert line[0].low == 0
            assert line[-1].high == float("inf")
            assert all(a.high == b.low for a, b in itertools.pairwise(line))
            ends = [piece.low for piece in line[1:]]  # where the verdict changes, exactly
            whole = isinstance(usual, ast.Duration) and usual.frames
            values = [rng.uniform(0, 2) * amount(usual) for _ in range(draws)]
            values = [float(round(value)) for value in values] if whole else values
            count = found.setdefault(param, [0, 0])
            for i, value in enumerate([*values, *ends[:3]]):
                (piece,) = [piece for piece in line if piece.low <= value < piece.high]
                count[1] += i < draws
                if piece.verdict is None:
                    continue
                count[0] += i < draws
                now = again.under(base, rule, {param: like(usual, value)})
                risk = at_risk(now.verdict, now.instances, now.vacuity)
                said = f"{again.episode.header.episode_id} {rule.code} {param} = {value!r}"
                assert (piece.verdict, piece.at_risk) == (now.verdict, risk), said
    return found


@pytest.mark.parametrize("part", range(3))
def test_recorded_episodes_agree_under_random_values(part):
    rules, rng, answers = load_rules(["ish", "ets", "fsh", "goals"]), random.Random(part), {}
    for ref in discover([ROOT / "traces"])[part::3]:
        for param, (decided, asked) in agreeing(Again(ref.open(), rules), rng).items():
            before = answers.get(param, (0, 0))
            answers[param] = before[0] + decided, before[1] + asked
    left = {param for param, (decided, asked) in answers.items() if decided < asked}
    assert not left & COMMON
    assert sum(asked for _, asked in answers.values()) > 50


SKETCHES = {
    "carried_past(gap = 8.1)": "ETS201",
    "carried_past(gap = 7.9)": "ETS202",
    "obstacle_disturbed": "ETS102",
    "obstacle_touched": "ETS101",
    "bystander_shoved": "ETS106",
    "neighbour_pushed(way = 1.1)": "FSH202",
    "creeping_after_success(until = 8.65)": "FSH106",
    "placed_without_success(margin = 1.9)": "FSH101",
    "left_beside": "FSH203",
    "can_wobbles_under_bottle": "ISH101",
    "lemon_tipped_out": "ISH203",
    "let_go_above(rate = 5)": "FSH105",
}


@pytest.mark.parametrize(("sketch", "code"), SKETCHES.items())
def test_examples_agree_under_random_values(sketch, code):
    episode = resolve(sketch, [ROOT / "rules" / "examples"])
    header = episode.header.model_copy(update={"rules": (code,)})
    again = Again(replace(episode, header=header), load_rules(["ish", "ets", "fsh", "goals"]))
    assert [rule.code for rule in again.assigned] == [code]
    agreeing(again, random.Random(code))


def test_the_limit_itself_belongs_to_the_side_that_the_rule_says():
    """``>=``: at the least room that it ever had the block stands far enough, and not beyond."""
    again = Again(block(room=0.012), load_rules(["fsh"]))
    rule = again.assigned[0]
    kept, broken = pieces(again, rule, "edge")
    assert (kept.verdict, broken.verdict) == ("pass", "violation")
    assert kept.high == pytest.approx(0.012, abs=1e-6)
    base, now = again.base(rule)
    assert now.violation
    values = [like(base.params["edge"], x) for x in (kept.high, now.value)]
    assert [again.under(base, rule, {"edge": v}).violation for v in values] == [True, False]


def test_what_changes_the_measurement_is_left_open():
    again = Again(block(), load_rules(["fsh"]))
    (only,) = pieces(again, again.assigned[0], "still_over")
    assert only == (0.0, float("inf"), None, False)
