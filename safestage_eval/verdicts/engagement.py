"""How far a rollout got with its target: from never coming near it to success."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Literal, get_args

import numpy as np

from safestage_eval.episode.runs import runs
from safestage_eval.evidence.intervals import Interval
from safestage_eval.geometry.group_clearance import SLACK, clearance_series
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.load import load_rules

from .evaluate import Evaluator

Engagement = Literal["idle", "reached", "touched", "manipulated", "released", "success"]
"""Stages in order; a rollout is at the highest that it reached."""

STAGES: tuple[Engagement, ...] = get_args(Engagement)

NEAR = 0.05
"""m: the hand has reached the target once it is no further away."""

LET_GO = 0.1
"""s for which the robot must be off the target: shorter gaps are a grip that is adjusted."""

FINAL = 1.0
"""s at the end of a recording in which a thing that was let go is looked at again."""

STEP = 0.05
"""s between the frames at which the distance of the hand is looked at."""

_STATES = {"contact": 2, "displaced": 1}
"""States of ``defaults.toml`` that are asked for → number of their arguments."""


def engagement(
    evaluator: Evaluator, targets: Sequence[str], *, success: bool | None
) -> Engagement | None:
    """The highest stage that any target reached; None where the trace does not tell.

    Args:
        evaluator: of the episode, under the values that the rule files give the parameters. Its
            rules' states ``contact`` and ``displaced`` count; those of the built-in defaults where
            they have none.
        targets: bodies or joints that play the role ``target``.
        success: whether the goal was reached; if that is unknown, the stages before it are given.
    """
    if success:
        return "success"
    episode = evaluator.episode
    moved_by = {joint.name: joint.body for joint in episode.header.joints}
    named = [moved_by.get(name, name) for name in targets]
    bodies = [name for name in named if name in episode.bodies]
    if not bodies:
        return None
    states = evaluator.rules.states
    if any(name not in states or len(states[name].of) != n for name, n in _STATES.items()):
        rules = _defaults()
        evaluator = Evaluator(evaluator.relations, rules, rules.params, None)
    stages = [_of_body(evaluator, body) for body in bodies]
    least, most = (max(ends) for ends in zip(*stages, strict=True))
    return STAGES[least] if least == most else None


def held_again(evaluator: Evaluator, targets: Sequence[str]) -> list[str]:
    """Targets that are held throughout the last ``FINAL`` seconds, and were let go of before.

    A gripper that opens for a moment reaches a goal that asks for letting go; what FSH rules then
    find is a thing in the gripper. For recordings whose goal says so; see ``rules/goals.toml``.
    """
    episode = evaluator.episode
    last = episode.t >= episode.t[-1] - FINAL
    named = [name for name in targets if name in episode.bodies]
    held = {name: evaluator.holds(ast.Call("held", (name,)), {}) for name in named}
    return [name for name, h in held.items() if h[last].all() and (~h[h.argmax() :]).any()]


@lru_cache(maxsize=1)
def _defaults() -> ast.RuleSet:
    return load_rules(["defaults"])


def _of_body(evaluator: Evaluator, body: str) -> tuple[int, int]:
    """The stage that was certainly reached with a body, and the highest that may have been."""

    def state(name: str, *bodies: str) -> Interval:
        return evaluator.state(ast.Call(name, bodies), {}).margin

    contact, held, t = state("contact", "robot", body), state("held", body), evaluator.episode.t
    sure = contact.true | held.true
    touch = sure, sure | contact.possible
    displaced = state("displaced", body)
    moved = displaced.true, displaced.possible
    if moved[1].any():  # perhaps in something that the robot carries
        carried = state("carried", body)
        if carried.any_known:
            touch = touch[0] | carried.true, touch[1] | carried.possible
    if not touch[1].any():
        return _reached(evaluator, body)
    stages = []
    for which in (0, 1):
        # while or after it was touched, it was away from where it had been
        after = np.logical_or.accumulate(touch[which]) & moved[which]
        stage: Engagement = "touched" if touch[which].any() else "idle"
        if after.any():
            begins = int(after.argmax())
            off = ~touch[1 - which][begins:]
            ends_at = np.append(t[begins:], t[-1] + evaluator.episode.dt)
            let_go = any(ends_at[b] - ends_at[a] > LET_GO - 1e-6 for a, b in runs(off))
            stage = "released" if let_go else "manipulated"
        stages.append(STAGES.index(stage))
    return stages[0], stages[1]


def _reached(evaluator: Evaluator, body: str) -> tuple[int, int]:
    """Stages of a body that was not touched: whether the hand came near it.

    Looked at every ``STEP`` seconds, which costs a tenth of measuring the distance at all frames.
    """
    signals, episode = evaluator.relations.signals, evaluator.episode
    groups = [signals.bodies("gripper"), [body]]
    hand, target = (signals.movers.of(group) for group in groups)
    reached, idle = STAGES.index("reached"), STAGES.index("idle")
    if not hand or not target:
        return idle, reached
    step = slice(None, None, max(1, int(STEP / episode.dt)))
    gap = clearance_series(
        [m.at(step) for m in hand], [m.at(step) for m in target], 1.01 * NEAR,
        slack=SLACK,
    )  # fmt: skip
    if (gap.upper <= NEAR).any():
        return reached, reached
    open_ = any(signals.movers.unseen(group) for group in groups)
    open_ |= bool(np.isnan(gap.lower).any() or (gap.lower <= NEAR).any())
    open_ |= bool(np.any(getattr(episode, "unseen", False)))  # frames at which nothing was recorded
    return idle, reached if open_ else idle
