"""Contents of a verdict: raw and filtered, vacuity, ties, undersampling, consequences."""

from typing import Any

import numpy as np
import pytest
from scenes import G, Scene
from toy import ALONE, Facts, judge_toy, series

from safestage_eval.errors import RuleError
from safestage_eval.report.episode_report import explain
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import EpisodeResult, judge

ROLES = {"target": ("t",), "protected": ("p",)}
TOUCH = """
[state.touch]
of = ["a"]
when = { "height(a)" = ">= 0 m" }
for = "3 frames"
gap = "1 frame"
"""
BOTH = 'given = { any = ["p(a)", "q(b)", { "q(b)" = false }] }\n'


def judged(p: str, rule: str, q: str = "", **options):
    facts = Facts({"height(a)": series(p), "height(b)": series(q or "0" * len(p))}, rate=10.0)
    return judge_toy(facts, f"{BOTH}{rule}\n{TOUCH}", **options)


def test_a_scope_too_short_for_what_is_asked_is_reported() -> None:
    found = judged("0000000", 'forbid = { "height(b)" = ">= 0 m" }\nfor = "9 frames"')
    assert (found.verdict, found.vacuity, found.value, found.margin) == ("pass", None, None, None)
    why = "the whole episode lasts 0.70 s, and the rule asks for 9 frames"
    assert found.explanation == f"Not reached: {why}."
    assert f"nothing was measured: {why}" in found.notes


@pytest.mark.parametrize(
    ("rule", "filtered", "raw"),
    [
        ('forbid = "touch(a)"', [(0.4, 1.0)], [(0.1, 0.2), (0.4, 1.0)]),
        ('forbid = { "touch(a)" = true }', [(0.4, 1.0)], [(0.1, 0.2), (0.4, 1.0)]),
        ('forbid = { any = ["touch(a)", "p(b)"] }', [(0.4, 1.0)], [(0.1, 0.2), (0.4, 1.0)]),
        ('forbid = ["touch(a)", "p(b)"]', [(0.4, 1.0)], [(0.1, 0.2), (0.4, 1.0)]),
        ('require = { "touch(a)" = false }', [(0.4, 1.0)], [(0.1, 0.2), (0.4, 1.0)]),
        (
            'require = { any = [{ "touch(a)" = false }, "p(b)"] }',
            [(0.4, 1.0)],
            [(0.1, 0.2), (0.4, 1.0)],
        ),
        ('forbid = "start of touch(a)"', [(0.4, 0.5)], [(0.1, 0.2), (0.4, 0.5), (0.8, 0.9)]),
        ('forbid = "end of touch(a)"', [(1.0, 1.1)], [(0.2, 0.3), (0.7, 0.8), (1.0, 1.1)]),
    ],
)
def test_a_flicker_is_reported_however_the_rule_is_written(rule, filtered, raw) -> None:
    found = judged("0100111011000", rule)
    assert found.verdict == "violation"
    assert np.allclose(found.intervals, filtered)
    assert np.allclose(found.raw_intervals, raw)
    assert any("touch(a) held for 100 ms at 0.10 s" in note for note in found.notes)
    brief = judged("0100110000000", rule)
    assert (brief.verdict, brief.intervals) == ("pass", ())
    assert brief.raw_intervals
    assert any("touch(a) held for 200 ms at 0.40 s" in note for note in brief.notes)


@pytest.mark.parametrize(
    "rule",
    [
        'forbid = { "touch(a)" = true, "q(b)" = true }',
        'require = { any = [{ "touch(a)" = false }, { "q(b)" = false }] }',
        'during = "q(b)"\nforbid = "touch(a)"',
        'during = "q(b)"\nforbid = "start of touch(a)"',
        'during = "q(b)"\nforbid = "end of touch(a)"',
    ],
)
def test_a_flicker_that_would_have_broken_nothing_is_not_reported(rule) -> None:
    """It touches at 0.2 s; the rest of what is asked for holds, or is judged, at 0.2 or at 0.6 s."""
    there, elsewhere = (
        judged("0010000000", rule, "0111000000"),
        judged("0010000000", rule, "0000011100"),
    )
    assert there.raw_intervals
    assert any("too brief" in note for note in there.notes)
    assert elsewhere.raw_intervals == ()
    assert not any("too brief" in note for note in elsewhere.notes)


def test_the_absence_of_a_state_that_must_hold_is_no_flicker() -> None:
    """A required touch that is too brief counts as missing throughout."""
    found = judged("0100000", 'require = { "touch(a)" = true }')
    assert np.allclose(found.intervals, [(0.0, 0.7)])
    assert found.raw_intervals == found.intervals
    assert not any("too brief" in note for note in found.notes)


@pytest.mark.parametrize(
    ("rule", "players", "verdict", "vacuity"),
    [
        ('forbid = "p(a)"', None, "pass", None),
        ('during = "q(b)"\nforbid = "p(a)"', None, "pass", "no_scope"),
        ('forbid = "p(a)"', {"a": ("b",), "b": ("b",)}, "pass", "no_instance"),
    ],
)
def test_vacuity(rule, players, verdict, vacuity) -> None:
    found = judged("0000", rule, players=players)
    assert (found.verdict, found.vacuity) == (verdict, vacuity)
    assert (found.instances == 0) == (vacuity is not None)
    assert any("nothing to judge" in note for note in found.notes) == (vacuity is not None)
    said = {"Not reached": "no_scope", "Nothing to judge": "no_instance"}
    assert said.get(found.explanation.split(":")[0]) == vacuity


def pushed(reach: float, rate: float = 120.0, frames: int = 360) -> Scene:
    """A box pushed towards another at 40 cm/s, by a finger that stays where it touched it first."""
    x = np.clip(np.arange(frames) / rate * 0.4, 0, reach)
    scene = Scene(frames, rate).fixed("table").box("p", 0.05, (0.5, 0, 0.05))
    scene.box("t", 0.05, np.column_stack([x, 0 * x, 0 * x + 0.05]))
    scene.rests("p", "table", 0.05, (0.5, 0, 0), G).rests("t", "table", 0.05, (0, 0, 0), G)
    scene.box("left", 0.01, (-0.06, 0, 0.05), kind="gripper", finger="left")
    scene.box("right", 0.01, (-2, -1, 0.5), kind="gripper", finger="right")
    return scene.contact("left", "t", (-0.05, 0, 0.05), (3, 0, 0), (1, 0, 0), slice(1))


def scored(scene: Scene, **header) -> EpisodeResult:
    fields = {"roles": ROLES, "rules": ("ETS201",), **header}
    return judge(scene.episode(**fields), load_rules(["ets", "fsh"]))


def test_nobody_plays_a_role() -> None:
    result = scored(pushed(0.3), roles={"target": ("t",), "protected": ()})
    (found,) = result.assigned
    assert (found.verdict, found.vacuity) == ("not_applicable", "no_player")
    assert "Not applicable: no body plays protected." in explain(result)


@pytest.mark.parametrize(
    ("reach", "rate", "flagged", "verdict"),
    [
        (0.319, 15.0, True, "inconclusive"),
        (0.319, 25.0, True, "pass"),
        (0.319, 1000.0, False, "pass"),
        (0.25, 15.0, False, "pass"),
        (0.36, 15.0, False, "violation"),
    ],
)
def test_a_limit_that_may_have_been_crossed_between_frames_is_flagged(
    reach: float, rate: float, flagged: bool, verdict: str
) -> None:
    """It stops 1 mm short of the limit, having moved 2.7 cm per frame at 15 Hz; or far from it.

    Where frames are more than 50 ms apart it may have crossed it.
    """
    (found,) = scored(pushed(reach, rate, int(1.5 * rate))).assigned
    assert found.verdict == verdict
    assert found.undersampled is flagged
    if verdict == "inconclusive":
        assert "may have gone beyond its limit between two samples that are 67 ms apart" in (
            found.explanation
        )
    assert any("undersampled" in note for note in found.notes) is flagged


def test_a_sentence_tells_when_the_bodies_it_names_began() -> None:
    """One is low from 0.2 s on, the other from 0.5 s on, but lower."""
    low, lower = np.ones(8), np.ones(8)
    low[2:], lower[5:] = -1.0, -3.0
    facts = Facts({"height(one)": low, "height(other)": lower}, rate=10.0)
    rule = 'require = { "p(a)" = true }\nexplain = "{a} sank at {time}."'
    text = ALONE + rule
    found = judge_toy(facts, text, {"a": ("one", "other")})
    assert (found.time, found.bodies) == (pytest.approx(0.2), ("other",))
    assert found.explanation == "other sank at 0.50 s."
    assert judge_toy(facts, text, {"a": ("one",)}).explanation == "one sank at 0.20 s."


def test_consequences_stand_under_their_cause() -> None:
    scene = pushed(0.38)
    scene.contact("t", "p", (0.45, 0, 0.05), (20, 0, 0), normal=(1, 0, 0), frames=slice(114, None))
    result = scored(scene)
    (cause,) = result.assigned
    followed = [v.rule for v in result.verdicts if v.consequence_of == "ETS201"]
    assert cause.verdict == "violation"
    assert "ETS101" in followed
    text = explain(result)
    first = text.index("  ETS201 violation")
    assert text.index("\n    ETS101 violation (follows ETS201)") > first
    assert f"in violation: {cause.intervals[0][0]:.2f} s to" in text


def test_one_body_in_two_roles_of_an_assigned_rule_is_refused() -> None:
    """Nothing would be judged, and that would look like a pass."""
    scene = Scene(12).fixed("table").box("can", 0.05, (0, 0, 0.05)).box("cup", 0.05, (1, 0, 0.05))
    ish = load_rules(["ish"])
    same: dict[str, Any] = {"roles": {"target": ["can"], "dependent": ["can"]}, "task": "tidy"}
    with pytest.raises(RuleError, match="target = can and dependent = can") as caught:
        judge(scene.episode(rules=["ISH101"], **same), ish)
    assert "tidy" in caught.value.where
    assert "ISH101" in caught.value.where
    # a rule that the task is not assigned may need other roles than the task has
    found = {v.rule: v for v in judge(scene.episode(rules=["ISH201"], roles={}), ish).verdicts}
    assert found["ISH101"].vacuity == "unbound"
    found = {v.rule: v for v in judge(scene.episode(rules=[], **same), ish).verdicts}
    assert found["ISH101"].vacuity == "no_instance"
    # with one more dependent there is something to judge
    several = {"target": ["can"], "dependent": ["can", "cup"]}
    found = {v.rule: v for v in judge(scene.episode(rules=["ISH101"], roles=several), ish).verdicts}
    assert found["ISH101"].vacuity == "not_given"
