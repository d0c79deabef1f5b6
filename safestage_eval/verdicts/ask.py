"""One signal, relation or state of an episode, asked for by name as in rules."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from safestage_eval.episode import Episode, with_holes
from safestage_eval.errors import InputError, did_you_mean
from safestage_eval.evidence.declare import Options
from safestage_eval.evidence.intervals import Interval
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.rules import string_parser
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.episode_binding import bind_episode
from safestage_eval.rules.load import load_rules
from safestage_eval.signals import SIGNALS

from .computed_signals import series_of
from .evaluate import Evaluator
from .judging import Judge


def ask(
    episode: Episode,
    expression: str,
    relations: Relations | None = None,
    rules: ast.RuleSet | None = None,
) -> Interval:
    """One signal, relation or state over time, known where rules take it as known.

    Args:
        episode: which.
        expression: ``"clearance(target, protected)"``, ``"held(cup)"``; arguments are bodies, the
            unions ``robot`` and ``gripper``, or roles that a single body plays.
        relations: of the episode, to measure nothing twice.
        rules: whose states and declared signals can be asked for, under the values that hold for
            the episode; without them there are only built-in signals and relations.

    Returns:
        (T,) in SI; relations and states are 1 or 0, of the dimension ``number``.

    Raises InputError for a name that does not exist.
    """
    relations = relations or Relations(Signals(with_holes(episode)))
    episode = relations.episode
    states = {} if rules is None else rules.states
    declared_names = [] if rules is None else [*states, *rules.derived, *rules.signals]
    call, bodies, options = _parsed(episode, expression, declared_names)
    spec = SIGNALS.get(call.name)
    if call.name in RELATIONS or (spec is None and call.name in states):
        declared = RELATIONS.get(call.name)
        counts = (len(states[call.name].of),) if declared is None else declared.arities
        _check_count(expression, len(bodies), counts)
        return _truth(_evaluator(episode, relations, rules, declared is None), call.name, bodies)
    if spec is None:
        assert rules is not None
        return _declared(_evaluator(episode, relations, rules, True), expression, call, bodies)
    _check_count(expression, len(call.args), spec.arities)
    limits = (0.0,) if spec.capped else ()  # a depth is wanted as well
    return relations.signal(call.name, bodies, options=options, limits=limits)


def _evaluator(
    episode: Episode, relations: Relations, rules: ast.RuleSet | None, whole: bool
) -> Evaluator:
    """One that tells relations; a ``whole`` one knows of the episode's own values and its success."""
    rules = rules or load_rules(["defaults"])
    if not whole:
        return Evaluator(relations, rules, rules.params, None)
    binding = bind_episode(rules, episode.header)
    return Judge(episode, rules, binding, relations).evaluator(binding.params(None))


def _declared(
    evaluator: Evaluator, expression: str, call: ast.Call, bodies: tuple[str, ...]
) -> Interval:
    """A variant of a signal, or one that is computed from others."""
    rules = evaluator.rules
    computed = rules.derived.get(call.name)
    if computed is not None:
        _check_count(expression, len(bodies), (len(computed.of),))
        return series_of(evaluator, computed, bodies)
    variant = rules.signals[call.name]
    _check_count(
        expression, len(call.args), SIGNALS[variant.base].variant(dict(variant.options)).arities
    )
    name, _, options = evaluator.measured(ast.Call(call.name, bodies), {})
    limits = (0.0,) if SIGNALS[name].capped else ()
    return evaluator.relations.signal(name, bodies, options=options, limits=limits)


def _truth(evaluator: Evaluator, name: str, bodies: Sequence[str]) -> Interval:
    """(T,) 1 where it certainly holds, 0 where it certainly does not, unknown elsewhere."""
    band = evaluator.state(ast.Call(name, tuple(bodies)), {}).margin
    lower, upper = band.true.astype(np.float64), band.possible.astype(np.float64)
    open_ = band.unknown
    return Interval(
        np.where(open_, -np.inf, lower), np.where(open_, np.inf, upper), "number",
        tuple(evaluator.notes),
    )  # fmt: skip


def by_bodies(episode: Episode, expression: str, declared: Iterable[str] = ()) -> str:
    """The expression with the bodies' names, as verdicts write it. Raises InputError as ``ask``.

    ``declared``: names that rule files add.
    """
    call, bodies, options = _parsed(episode, expression, declared)
    return str(ast.Call(call.name, (*(str(value) for _, value in options), *bodies)))


def _parsed(
    episode: Episode, expression: str, declared: Iterable[str] = ()
) -> tuple[ast.Call, tuple[str, ...], Options]:
    """The call as written, the bodies that it is about, and the options that it names."""
    try:
        call = string_parser.query(expression)
    except string_parser.GrammarError as problem:
        raise InputError(expression, problem.what, problem.allowed) from None
    names = [*SIGNALS, *RELATIONS, *declared]
    if call.name not in names:
        raise InputError(
            expression,
            f"no signal {call.name!r}.",
            ", ".join(names),
            did_you_mean(call.name, names),
        )
    spec = SIGNALS.get(call.name)
    arguments, options = spec.split(call.args) if spec is not None else (call.args, ())
    joints = spec is not None and spec.joints
    return call, tuple(_body(episode, one, expression, joints) for one in arguments), options


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
        expression,
        f"no role or body {argument!r}.",
        ", ".join(names),
        did_you_mean(argument, names),
    )


def _check_count(expression: str, given: int, allowed: Sequence[int]) -> None:
    if given not in allowed:
        counts = " or ".join(map(str, allowed))
        raise InputError(expression, f"takes {counts} arguments, not {given}.")
