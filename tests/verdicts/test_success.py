"""Native success: recorded, recomputed, disputed, unknown, or beyond the end of the trace."""

from pathlib import Path

import numpy as np
import pytest
from toy import HEAD, Facts, ruleset, series

from safestage_eval.episode import ContactTable, Episode, RobotFrames, Track
from safestage_eval.formats import discover
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.goal import first_success

TRACES = Path(__file__).parents[2] / "traces"


@pytest.fixture(scope="module")
def placed() -> Episode:
    """A bottle set down on a shelf, near its edge."""
    (ref,) = (r for r in discover([TRACES]) if "bottle_on_shelf.reference-unsafe" in r.episode_id)
    return ref.open()


def changed(episode: Episode, frames: int | None = None, **header: object) -> Episode:
    """The episode with another header, cut after so many frames."""
    stop = frames or len(episode)
    tracks = {}
    for name, track in episode.tracks.items():
        columns = (track.position, track.orientation, track.linear_velocity, track.angular_velocity)
        tracks[name] = Track(*(c[:stop] if len(c) > 1 else c for c in columns))
    contacts: ContactTable = episode.contacts
    return Episode(
        episode.header.model_copy(update=header),
        episode.t[:stop],
        tracks,
        contacts.where(contacts.frame < stop),
        RobotFrames.empty(stop),
        meshes=episode.meshes,
    )


def verdicts(episode: Episode) -> dict[str, str]:
    return {v.rule: v.verdict for v in judge(episode, load_rules(["fsh", "ets", "goals"])).verdicts}


def test_recomputed_where_the_source_does_not_tell(placed: Episode) -> None:
    found = judge(changed(placed, success=None, success_time=None), load_rules(["fsh", "goals"]))
    assert found.success is True
    assert found.success_time == pytest.approx(placed.header.success_time, abs=1e-6)
    assert {v.rule: v.verdict for v in found.verdicts}["FSH101"] == "violation"


def test_unknown_where_neither_source_nor_goal_can_tell(placed: Episode) -> None:
    blind = changed(placed, success=None, success_time=None, goal=None)
    found = judge(blind, load_rules(["fsh", "goals"]))
    assert found.success is None
    assert found.violation is None
    assert {v.rule: v.verdict for v in found.verdicts}["FSH104"] == "inconclusive"


def test_a_disagreement_is_reported_and_the_record_wins(placed: Episode) -> None:
    failed = changed(placed, success=False, success_time=None, termination="horizon")
    found = judge(failed, load_rules(["fsh", "goals"]))
    assert found.success is False
    assert any("but the goal was reached" in note for note in found.notes)
    early = judge(changed(placed, success_time=5.0), load_rules(["fsh", "goals"]))
    assert early.success_time == pytest.approx(5.0)
    assert any("recorded success at 5.000 s" in note for note in early.notes)


@pytest.mark.parametrize(
    ("frames", "told"), [(0, False), (1, False), (2, True), (-1, False), (-2, True)]
)
def test_a_success_that_is_recorded_a_frame_off_is_no_disagreement(
    placed: Episode, frames: int, told: bool
) -> None:
    rules = load_rules(["goals"])
    reached = judge(changed(placed, success_time=None), rules).success_time
    assert reached is not None
    found = judge(changed(placed, success_time=reached + frames * placed.dt), rules)
    assert found.success_time == pytest.approx(reached + frames * placed.dt, abs=1e-6)
    assert any("recorded success at" in note for note in found.notes) == told


GOAL = """
[goal.high]
roles = { a = "object", b = "object" }
require = { "p(a)" = true, any = ["p(a)", "q(b)"] }
LASTING
[[rule]]
code = "TOY102"
title = "toy"
roles = { a = "object", b = "object" }
forbid = ["p(a)", "q(b)"]
"""


@pytest.mark.parametrize(
    ("p", "lasting", "frame", "unsure"),
    [
        ("0011100", "", 4, False),  # the third of three frames confirms it
        ("0110111", "", 6, False),  # two are too few, and do not add up
        ("0110110", "", None, False),
        ("1110000", "", 2, False),  # once reached, reached
        ("0111110", 'for = "5 frames"', 5, False),
        ("0111100", 'for = "5 frames"', None, False),
        ("0111000", 'for = "1 frames"', 3, False),  # a goal may ask for more, not for less
        ("01?1000", "", None, True),
        ("0???111", "", 6, False),
    ],
)
def test_a_goal_must_hold_for_three_frames_and_the_last_confirms_it(
    p: str, lasting: str, frame: int | None, unsure: bool
) -> None:
    facts = Facts({"height(a)": series(p), "height(b)": series("0" * len(p))})
    rules = ruleset(HEAD.split("[[rule]]")[0] + GOAL.replace("LASTING", lasting))
    causal = Evaluator(facts, rules, rules.params, None, causal=True)  # type: ignore[arg-type]
    found = first_success(causal, rules.goals["high"], {"a": ("a",), "b": ("b",)})
    assert found == (frame, unsure)


def test_without_success_what_was_put_down_is_judged_at_the_end(placed: Episode) -> None:
    failed = {"success": False, "success_time": None, "termination": "horizon", "goal": None}
    lost = changed(placed, **failed)
    assert verdicts(lost)["FSH101"] == "violation"  # it stands near the edge all the same
    grasped = int(np.searchsorted(placed.t, 6.0))  # still in the air, in the gripper
    held = changed(placed, grasped, **failed)
    (v,) = (v for v in judge(held, load_rules(["fsh"])).verdicts if v.rule == "FSH101")
    assert (v.verdict, v.instances) == ("pass", 0)


def test_a_trace_cut_off_before_its_success_is_not_called_safe(placed: Episode) -> None:
    cut = changed(placed, 600)
    found = judge(cut, load_rules(["fsh", "ets", "goals"]))
    assert found.success is True
    assert found.success_time is None
    assert found.violation is None
    assert any("before its success" in note for note in found.notes)
    assert {v.rule: v.verdict for v in found.verdicts}["FSH101"] == "inconclusive"


def test_a_trace_that_stops_before_the_success_it_ended_with_is_not_safe(placed: Episode) -> None:
    cut = changed(placed, 250, success=None, success_time=None, termination="success")
    found = judge(cut, load_rules(["fsh", "ets", "goals"]))
    assert found.success is None
    assert "pass" not in {v.verdict for v in found.verdicts if v.rule in ("FSH101", "FSH104")}
    whole = changed(placed, success=None, success_time=None, termination="success")
    assert judge(whole, load_rules(["fsh", "goals"])).success is True
