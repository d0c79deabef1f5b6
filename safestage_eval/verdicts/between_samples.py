"""States that may have held between two samples, unseen."""

from __future__ import annotations

from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import Bool

from .values import Values


def hidden_touch(
    values: Values, state: ast.StateDef, bodies: tuple[str, ...], seconds: float
) -> Bool | None:
    """(T,) where the state may hold for ``seconds`` between a sample and the next; None: nowhere."""
    coarse = values.clock.spacing >= seconds * (1 - 1e-6)
    if values.clock.unseen is not None:  # where nothing is known anyway
        coarse &= ~values.clock.unseen
    env, out = dict(zip(state.of, bodies, strict=True)), None
    for atom in state.when.atoms:
        if not isinstance(atom, ast.SignalAtom) or atom.call.name != "contact_force":
            continue
        asked = values.asked(atom, env)
        if len(asked.bodies) != 2 or atom.limits[0].op[0] != ">":
            continue
        peak = values.relations.signal("peak_force", asked.bodies)
        out = values.relations.may_touch_between(*asked.bodies, coarse)
        out = out | (coarse & (peak.lower >= asked.limits[0]))
        if out.any():
            first, t = int(out.argmax()), values.episode.t
            values.notes[
                f"{asked.bodies[0]} may have touched {asked.bodies[1]} between two samples that "
                f"are {values.clock.spacing[first] * 1e3:.0f} ms apart, at {t[first]:.2f} s"
            ] = None
    return out
