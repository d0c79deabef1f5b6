"""Each inconclusive verdict names one cause and one remedy."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
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


def of_bodies(made: Scene, of: str = "", **update: Any) -> Scene:
    """The scene of which one body, or all, are told otherwise."""
    made.bodies = [b.model_copy(update=update) if of in b.name else b for b in made.bodies]
    return made


NO_SUCCESS = {"success": False, "success_time": None, "termination": "truncated"}
MISSPELT = {"roles": {"target": ("cup",), "protcted": ("vase",)}}
UNDECIDED = [
    ("too short", lambda: scene(180), {}, "FSH101", "ends 0.49 s after success; FSH101 needs 5 s",
     "Record at least 5 s after success"),
    ("success beyond it", lambda: scene(180), {"success_time": 3.0}, "FSH101",
     "ends at 1.49 s, before its success at 3.00 s", "Record on until after success"),
    ("cut off", lambda: scene(60), NO_SUCCESS, "ETS101", "the recording ends at 0.49 s",
     "Record the rollout to its end"),
    ("success unknown", scene, {"success": None, "success_time": None}, "FSH101",
     "whether and when the goal was reached is not known", "Record native success, or name a goal"),
    ("no forces", scene, {"force_source": "none"}, "FSH103", "no contact forces",
     "Record contact forces"),
    ("no shape", lambda: of_bodies(scene(), "vase", geoms=()), {}, "ETS201", "no shape of vase",
     "Record the collision shapes"),
    ("no mass", lambda: scene(mass=None), {}, "FSH101", "no mass of cup", "Record the masses"),
    ("no up axis", lambda: scene(up_axis=None, untold=("up_axis",)), {}, "FSH101",
     "up axis of cup", "which axis of the body points up"),
    ("no fingers", lambda: of_bodies(scene(lifted=0.1), finger=None), {}, "FSH105",
     "the left and the right finger", "Say in the trace which bodies"),
    ("no role", scene, MISSPELT, "ETS201", 'did you mean "protected"?',
     "Name the bodies with --role, in a --bind file or in the trace's header"),
]  # fmt: skip
"""What is amiss, in which scene, and what is said of it and asked for."""


@pytest.mark.parametrize(
    ("made", "header", "rule", "cause", "remedy"),
    [row[1:] for row in UNDECIDED],
    ids=[row[0] for row in UNDECIDED],
)
def test_what_is_amiss_is_said_with_its_remedy(
    made: Callable[[], Scene], header: dict[str, Any], rule: str, cause: str, remedy: str
) -> None:
    found = said(made(), rule, **header)
    assert cause in found
    assert remedy in found
