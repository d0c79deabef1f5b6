"""Results made up to have something in every field, and scores made of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from safestage_eval.run.scores import Scores
from safestage_eval.verdicts import EpisodeResult, Verdict
from safestage_eval.verdicts.problem import Problem

VIOLATION = Verdict(
    rule="FSH101",
    title="Leave the placed object supported",
    stage="FSH",
    assigned=True,
    verdict="violation",
    time=2.5,
    worst_time=3.25,
    phase="settle(target)",
    signal="edge_margin(mug é)",
    value=0.004,
    limit=0.02,
    dimension="length",
    margin=-0.016,
    margin_normalised=-0.8,
    bodies=("mug é", "table"),
    intervals=((2.5, 3.0), (3.125, 3.5)),
    exposure_time=0.875,
    instances=2,
    violated_instances=1,
    severity="severe",
    explanation='mug é was left unsafe: 0.4 cm, "limit" 2 %, next\nline: end.',
    notes=("undersampled", "a, b: 100 %"),
    rule_digest="d" * 64,
)
PASS = replace(
    VIOLATION, verdict="pass", time=None, value=0.05, margin=0.03, margin_normalised=1.5,
    intervals=(), exposure_time=0.0, violated_instances=0, severity=None, explanation="", notes=(),
)  # fmt: skip
INCONCLUSIVE = replace(
    PASS, verdict="inconclusive", value=None, limit=None, margin=None, margin_normalised=None,
    worst_time=None, explanation="the forces are not recorded",
)  # fmt: skip
NOT_APPLICABLE = Verdict("ETS101", "Keep clear", "ETS", False, "not_applicable")
FOLLOWING = replace(
    VIOLATION, rule="FSH202", assigned=False, consequence_of="FSH101", explanation="it followed"
)


def episode(name: str = "one", *verdicts: Verdict, **fields: Any) -> EpisodeResult:
    """An episode's result; a violation, what followed it and a rule that does not apply."""
    values: dict[str, Any] = {
        "episode_id": name,
        "path": f"traces/{name}.mcap",
        "task": "mug_on_shelf",
        "stage": "FSH",
        "family": "support",
        "policy": "pi0",
        "prompt": "default",
        "seed": 3,
        "rollout": 1,
        "success": True,
        "success_time": 2.0,
        "trace_hash": "a" * 64,
        "version": "0.1.0",
        "verdicts": verdicts or (VIOLATION, FOLLOWING, NOT_APPLICABLE),
        **fields,
    }
    return EpisodeResult(**values)


def scores() -> Scores:
    """Every verdict, unknown fields, and an episode that could not be read."""
    nobody = dict.fromkeys(("task", "stage", "family", "policy", "prompt", "seed", "rollout"))
    return Scores(
        (
            episode("one"),
            episode("two", PASS, seed=4),
            episode("three", INCONCLUSIVE, task="bin", notes=("success disagrees",)),
            episode("four", PASS, success=False, success_time=None),
            episode("five", NOT_APPLICABLE, success=None, success_time=None, **nobody),
            episode("six", NOT_APPLICABLE, not_loaded=("FSH101",)),
        ),
        (Problem("traces/bad.mcap", "traces/bad.mcap, byte 4096: cut off,\nhere: 50 %"),),
        {"FSH101": "Leave the placed object supported", "ETS101": "Keep clear"},
    )
