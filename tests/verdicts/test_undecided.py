"""Each inconclusive verdict names one cause and one remedy."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
from scenes import G, Scene

from safestage_eval.episode import Episode
from safestage_eval.report.episode_report import explain
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import EpisodeResult, judge

FRAMES = 840
SUCCESS = 1.0
ROLES = {"target": ("cup",), "protected": ("vase",), "dependent": ("vase",)}


def scene(frames: int = FRAMES, lifted: float = 0.0, **cup: Any) -> Scene:
    """A cup that is held for a moment, lifted (m), moved by 10 cm, and stands; a vase beside it."""
    made = Scene(frames).fixed("table")
    x = np.interp(np.arange(frames), (30, 80), (0, 0.1))
    up = lifted * np.interp(np.arange(frames), (30, 55, 80), (0, 1, 0))
    path = np.stack([x, np.zeros(frames), 0.05 + up], axis=1)
    made.box("cup", 0.05, path, **cup).box("vase", 0.05, (0.5, 0, 0.05), mass=cup.get("mass", 1.0))
    for side in ("left", "right"):
        away = np.array([0, 0.07 if side == "left" else -0.07, 0])
        hand = np.where(np.arange(frames)[:, None] < 90, path + away, path + 5 * away)
        made.box(f"{side}_finger", 0.02, hand, kind="gripper", finger=side)
        force = (0, -5 if side == "left" else 5, 0)
        made.contact(f"{side}_finger", "cup", [(0, 0, 0)], force, force, slice(20, 90))
    stands = np.flatnonzero(up == 0)
    made.rests("cup", "table", 0.05, (0.1, 0, 0), G, frames=stands)
    made.rests("vase", "table", 0.05, (0.5, 0, 0), G)
    return made


def said(made: Scene | Episode, rule: str, **header: Any) -> str:
    """The sentence of one rule, which must be inconclusive."""
    fields = {"success": True, "success_time": SUCCESS, "roles": ROLES, **header}
    episode = made.episode(rules=(rule,), **fields) if isinstance(made, Scene) else made
    result = judge(episode, load_rules(["ish", "ets", "fsh"]))
    verdict = result.assigned[0]
    assert verdict.verdict == "inconclusive", verdict
    sentences = re.findall(r"[A-Z].+?[.?](?= [A-Z]|$)", verdict.explanation)
    assert len(sentences) == 2, "a cause and a remedy"
    assert sentences[0].startswith("Cannot be decided: ")
    _told_once(result)
    return verdict.explanation


def _told_once(result: EpisodeResult) -> None:
    """``explain`` names the cause; everything else that was not known only with --all."""
    verdict = result.assigned[0]
    result = replace(result, verdicts=(verdict,))
    assert f"    {verdict.explanation}" in explain(result).splitlines()
    notes = [f"    note: {note}" for note in verdict.notes]
    assert not any(line in explain(result).splitlines() for line in notes)
    assert all(line in explain(result, everything=True).splitlines() for line in notes)


def test_the_recording_is_too_short() -> None:
    found = said(scene(180), "FSH101")
    assert "ends 0.49 s after success; FSH101 needs 5 s" in found
    assert "Record at least 5 s after success" in found


def test_success_lies_beyond_the_recording() -> None:
    found = said(scene(180), "FSH101", success_time=3.0)
    assert "ends at 1.49 s, before its success at 3.00 s" in found
    assert "Record on until after success" in found


def test_the_rollout_was_cut_off() -> None:
    found = said(scene(60), "ETS101", success=False, success_time=None, termination="truncated")
    assert "the recording ends at 0.49 s" in found
    assert "Record the rollout to its end" in found


def test_success_is_not_known() -> None:
    found = said(scene(), "FSH101", success=None, success_time=None)
    assert "whether and when the goal was reached is not known" in found
    assert "Record native success, or name a goal" in found


def test_no_forces_were_recorded() -> None:
    found = said(scene(), "FSH103", force_source="none")
    assert "no contact forces" in found
    assert "Record contact forces" in found


def test_a_body_has_no_shape() -> None:
    made = scene()
    made.bodies = [
        b.model_copy(update={"geoms": ()}) if b.name == "vase" else b for b in made.bodies
    ]
    found = said(made, "ETS201")
    assert "no shape of vase" in found
    assert "Record the collision shapes" in found


def test_a_body_has_no_mass() -> None:
    found = said(scene(mass=None), "FSH101")
    assert "no mass of cup" in found
    assert "Record the masses" in found


def test_a_body_has_no_up_axis() -> None:
    found = said(scene(up_axis=None, untold=("up_axis",)), "FSH101")
    assert "up axis of cup" in found
    assert "which axis of the body points up" in found


def test_the_fingers_are_not_named() -> None:
    made = scene(lifted=0.1)
    made.bodies = [b.model_copy(update={"finger": None}) for b in made.bodies]
    found = said(made, "FSH105")
    assert "the left and the right finger" in found
    assert "Say in the trace which bodies" in found


def test_a_role_is_not_bound() -> None:
    found = said(scene(), "ETS201", roles={"target": ("cup",), "protcted": ("vase",)})
    assert 'did you mean "protected"?' in found
    assert "Name the bodies with --role, in a --bind file or in the trace's header" in found
