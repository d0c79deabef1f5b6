"""No violation speaks only of bodies that the robot had nothing to do with, judged by the contacts alone."""

from __future__ import annotations

import pytest
from robot_touches import touch_times, unfounded

from safestage_eval.rules import load_rules
from safestage_eval.sketch import resolve
from safestage_eval.verdicts import judge

SKETCHES = [
    "slides_past_alone",
    "slides_past_alone(has = dumbbell)",
    "pushed_against",
    "drops_alone",
    "drops_alone(has = block)",
    "bystander_shoved(way = 8)",
]


@pytest.mark.parametrize("name", SKETCHES)
def test_violations_are_led_to_by_touches(name: str) -> None:
    episode = resolve(name)
    verdicts = judge(episode, load_rules(["ets", "fsh"])).verdicts
    assert not [v.rule for v in verdicts if unfounded(episode, v)]
    found = {v.rule for v in verdicts if v.verdict == "violation"}
    assert ("ETS201" in found) == (name.startswith("pushed") or "dumbbell" in name)


def test_what_the_robot_never_reaches_would_be_unfounded() -> None:
    episode = resolve("slides_past_alone(has = dumbbell)")
    [verdict] = [v for v in judge(episode, load_rules(["ets"])).verdicts if v.rule == "ETS201"]
    assert verdict.verdict == "violation"
    alone = resolve("slides_past_alone")
    assert "dumbbell" not in touch_times(alone)
    assert unfounded(alone, verdict)
