"""Where a state may have held too briefly for the samples, or between two of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from safestage_eval.rules import syntax as ast
from safestage_eval.states import persistence
from safestage_eval.states.band import F64, Bool

if TYPE_CHECKING:
    from .evaluate import Evaluator


def may_last(
    evaluator: Evaluator, state: ast.StateDef, name: str, bodies: tuple[str, ...], seconds: float
) -> F64:
    """(T,) upper margin of a state that lasts at least as long as its samples may have."""
    loose = persistence.persistent(
        evaluator.momentary(name, bodies),
        evaluator.window(state.for_).loose,
        evaluator.open_gap(state.gap),
        causal=evaluator.causal,
        open_end=evaluator.unfollowed,
    )
    if evaluator.clock.longest < seconds * (1 - 1e-6):
        return loose.upper
    hidden = hidden_touch(evaluator, state, bodies, seconds)
    return loose.upper if hidden is None else np.where(hidden, np.inf, loose.upper)


def hidden_touch(
    evaluator: Evaluator, state: ast.StateDef, bodies: tuple[str, ...], seconds: float
) -> Bool | None:
    """(T,) where the state may hold for so long between a sample and the next, unseen."""
    coarse = evaluator.clock.spacing >= seconds * (1 - 1e-6)
    if evaluator.clock.unseen is not None:  # where nothing is known anyway
        coarse &= ~evaluator.clock.unseen
    env, out = dict(zip(state.of, bodies, strict=True)), None
    for atom in state.when.atoms:
        if not isinstance(atom, ast.SignalAtom) or atom.call.name != "contact_force":
            continue
        asked = evaluator.asked(atom, env)
        if len(asked.bodies) != 2 or atom.limits[0].op[0] != ">":
            continue
        peak = evaluator.relations.signal("peak_force", asked.bodies)
        out = evaluator.relations.may_touch_between(*asked.bodies, coarse)
        out = out | (coarse & (peak.lower >= asked.limits[0]))
        if out.any():
            first, t = int(out.argmax()), evaluator.episode.t
            evaluator.notes[
                f"{asked.bodies[0]} may have touched {asked.bodies[1]} between two samples that "
                f"are {evaluator.clock.spacing[first] * 1e3:.0f} ms apart, at {t[first]:.2f} s"
            ] = None
    return out
