"""One signal or relation of an episode, asked for by name as in rules."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safestage_eval.episode import Episode, with_holes
from safestage_eval.errors import InputError
from safestage_eval.relations.measure import Relations
from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.rules import parse
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.names import nearest
from safestage_eval.signals.measure import Signals
from safestage_eval.signals.series import Series, exact, hide, unknown
from safestage_eval.signals.vocabulary import SIGNALS


def ask(episode: Episode, expression: str, relations: Relations | None = None) -> Series:
    """One signal or relation over time.

    Args:
        episode: which.
        expression: ``"clearance(target, protected)"``, ``"held(cup)"``; arguments are bodies, the
            unions ``robot`` and ``gripper``, or roles that a single body plays.
        relations: of the episode, to measure nothing twice.

    Returns:
        (T,) in SI; relations are 1 or 0, of the dimension ``number``.

    Raises InputError for a name that does not exist.
    """
    call = _parsed(expression)
    relations = relations or Relations(Signals(with_holes(episode)))
    episode = relations.episode
    spec = SIGNALS.get(call.name)
    arguments, options = spec.split(call.args) if spec is not None else (call.args, ())
    joints = spec is not None and spec.joints
    bodies = [_body(episode, argument, expression, joints) for argument in arguments]
    if call.name in RELATIONS:
        _check_count(expression, len(bodies), (RELATIONS[call.name].args,))
        truth = relations.get(call.name, bodies)
        if truth is None:
            return unknown(len(episode), "number", relations.lacking(call.name, bodies))
        found = exact(truth.astype(np.float64), "number")
        return found if episode.unseen is None else hide(found, episode.unseen)
    if spec is None:
        names = [*SIGNALS, *RELATIONS]
        raise InputError(
            expression, f"no signal {call.name!r}.", ", ".join(names), nearest(call.name, names)
        )
    _check_count(expression, len(call.args), spec.args)
    return relations.signal(call.name, bodies, options=options)


def by_bodies(episode: Episode, expression: str) -> str:
    """The expression with the bodies' names, as verdicts write it. Raises InputError as ``ask``."""
    call = _parsed(expression)
    spec = SIGNALS.get(call.name)
    arguments, options = spec.split(call.args) if spec is not None else (call.args, ())
    joints = spec is not None and spec.joints
    bodies = tuple(_body(episode, argument, expression, joints) for argument in arguments)
    return str(ast.Call(call.name, (*(str(value) for _, value in options), *bodies)))


def _parsed(expression: str) -> ast.Call:
    try:
        return parse.call(expression)
    except parse.GrammarError as problem:
        raise InputError(expression, problem.what, problem.allowed) from None


def _body(episode: Episode, argument: str, expression: str, joints: bool) -> str:
    players = episode.header.roles.get(argument, ())
    named = [joint.name for joint in episode.header.joints] if joints else []
    if len(players) == 1:
        argument = players[0]
    if argument in episode.bodies or argument in named or argument in ("robot", "gripper"):
        return argument
    if players:
        raise InputError(
            expression, f"several bodies play {argument!r}.", ", ".join(players), "name one"
        )
    names = [*episode.header.roles, *episode.bodies, *named, "robot", "gripper"]
    raise InputError(
        expression, f"no role or body {argument!r}.", ", ".join(names), nearest(argument, names)
    )


def _check_count(expression: str, given: int, allowed: Sequence[int]) -> None:
    if given not in allowed:
        counts = " or ".join(map(str, allowed))
        raise InputError(expression, f"takes {counts} arguments, not {given}.")
