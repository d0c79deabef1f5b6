"""One sentence per finding: what, when, by how much and why."""

from __future__ import annotations

import re
import string
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from safestage_eval.episode.runs import runs
from safestage_eval.rules import parse
from safestage_eval.rules import syntax as ast
from safestage_eval.units import format_quantity, told_apart

from .evaluate import Evaluator
from .players import nodes
from .values import Env
from .verdict import VerdictName
from .witness import Witness


class Finding(NamedTuple):
    """Of a verdict, what its sentence says besides the witness; fields as there."""

    verdict: VerdictName
    time: float | None
    worst_time: float | None
    margin: float | None


def inconclusive(cause: str, remedy: str = "") -> str:
    """``Cannot be decided: CAUSE. REMEDY.``: the sentence of an inconclusive verdict."""
    end = "" if cause.endswith(("?", ".")) else "."
    remedy = f" {remedy[:1].upper()}{remedy[1:]}." if remedy else ""
    return f"Cannot be decided: {cause}{end}{remedy}"


def seconds(time: float | None) -> str:
    """A time as sentences say it; None is ``never``."""
    return "never" if time is None else f"{time:.2f} s"


def worded(text: str) -> str:
    """A filled template in which moments read as such.

    What did not happen: ``moved at never`` → ``never moved``. What began, where others measure a
    value: ``lost(bottle) was 4.48 s at 4.48 s`` → ``lost(bottle) came at 4.48 s``.
    """
    text = re.sub(r"\b(\w+) at never\b", r"never \1", text)
    return re.sub(r"\bwas (\d+\.\d\d s) at \1", r"came at \1", text)


def measured(value: float | None, witness: Witness) -> str:
    """A value of the witness's dimension with its unit."""
    if value is None or witness.dimension is None:
        return "never" if witness.dimension == "time" else "–"
    known = format_quantity(value, witness.dimension)
    if (
        witness.value is not None
        and witness.limit is not None
        and value in (witness.value, witness.limit)
    ):
        pair = told_apart(witness.value, witness.limit, witness.dimension)
        known = pair[0] if value == witness.value else pair[1]
    return f"at least {known}" if witness.at_least and value == witness.value else known


def sentence(
    evaluator: Evaluator,
    rule: ast.Scoped,
    env: Env,
    witness: Witness,
    verdict: Finding,
) -> str:
    """The rule's own ``explain`` filled in for a violation; a plain sentence otherwise.

    A state that decided it, and has a sentence of its own, is told by that.
    """
    if verdict.verdict == "violation" and witness.state is not None:
        return worded(_of_state(evaluator, witness.state, env))
    if verdict.verdict == "violation" and rule.explain:
        words = _words(env, witness, verdict)
        after = float(evaluator.episode.t[witness.frame])
        return worded(_Template(evaluator, rule, env, words, after).format(rule.explain))
    if verdict.verdict == "violation" and witness.value is None:
        return f"{witness.signal} broke the rule at {seconds(verdict.time)}."
    if verdict.verdict == "violation":
        return (
            f"{witness.signal} was {measured(witness.value, witness)} at "
            f"{seconds(verdict.worst_time)}; the limit is {measured(witness.limit, witness)}."
        )
    if witness.dimension == "time":
        return (
            f"{witness.signal} came at {seconds(witness.value)}, after it was safe "
            f"from {seconds(witness.limit)} on."
            if witness.value is not None
            else f"{witness.signal} never came."
        )
    if verdict.verdict == "pass" and verdict.margin is not None:
        if untouched(witness):
            return f"No contact: {witness.signal} was {_of_limit(witness)}."
        return (
            f"Closest: {witness.signal} was {measured(witness.value, witness)} at "
            f"{seconds(verdict.worst_time)}; the limit is {measured(witness.limit, witness)}."
        )
    return ""


def untouched(witness: Witness) -> bool:
    """The decisive value is a contact force of zero: the bodies did not touch at all."""
    return witness.name == "contact_force" and witness.value == 0


def alike(witness: Witness, kept: str) -> str:
    """The sentence of a pass that several measurements decide alike; the witness is one of them.

    If they are of other bodies, its value is theirs; if of other signals, none speaks for all, and
    the sentence is ``kept``.
    """
    if untouched(witness):
        return f"No contact: {_of_limit(witness)}."
    if witness.value is None or witness.tied:
        return kept
    name = witness.signal.partition("(")[0]
    value, limit = measured(witness.value, witness), measured(witness.limit, witness)
    return f"Closest, several alike: {name} was {value}; the limit is {limit}."


def _of_limit(witness: Witness) -> str:
    return f"{measured(witness.value, witness)} of {measured(witness.limit, witness)}"


def _of_state(evaluator: Evaluator, call: ast.Call, env: Env) -> str:
    """The filled ``explain`` of a state; ``call`` names one that has it."""
    state = evaluator.rules.states[call.name]
    inner = {formal: env.get(arg, arg) for formal, arg in zip(state.of, call.args, strict=True)}
    words = _bodies(inner)
    began = onset(evaluator, [ast.Call(state.name, state.of)], inner)
    words["time"] = seconds(began)
    return _Template(evaluator, state, inner, words, began).format(state.explain)


def onset(
    evaluator: Evaluator, calls: Iterable[ast.Call], env: Env, after: float | None = None
) -> float | None:
    """S, when one of some states first became true for these bodies; None if never.

    ``after``: s; what began before does not count.
    """
    t = evaluator.episode.t
    earliest = 0 if after is None else int(np.searchsorted(t, after))
    begun = [
        first
        for call in calls
        for first, _ in runs(evaluator.holds(call, env, max(earliest - 1, 0)))
    ]
    frames = [int(first) for first in begun if first >= earliest]
    return float(t[min(frames)]) if frames else None


def mentioned_next(text: str) -> list[ast.Call]:
    """The states in ``{next.STATE(role, …)}`` of a sentence."""
    fields = [name for _, name, _, _ in string.Formatter().parse(text) if name is not None]
    return [parse.call(f.removeprefix("next.")) for f in fields if f.startswith("next.")]


def _bodies(env: Env) -> dict[str, str]:
    return {role: body.replace("_", " ") for role, body in env.items()}


class _Template(string.Formatter):
    """Fills in words, and ``{t.STATE}`` and ``{next.STATE(role, …)}`` with when a state began."""

    def __init__(
        self,
        evaluator: Evaluator,
        user: ast.Scoped | ast.StateDef,
        env: Env,
        words: dict[str, str],
        after: float | None,
    ) -> None:
        """``after``: s; what comes next comes after that."""
        self._evaluator, self._user, self._env, self._words = evaluator, user, env, words
        self._after = after

    def get_field(self, field_name: str, *_: Any) -> tuple[str, str]:
        if field_name in self._words:
            return self._words[field_name], field_name
        if field_name.startswith("t."):
            return self._onset(field_name.removeprefix("t.")), field_name
        if field_name.startswith("next."):
            call = parse.call(field_name.removeprefix("next."))
            return seconds(onset(self._evaluator, [call], self._env, self._after)), field_name
        return "{" + field_name + "}", field_name

    def _onset(self, state: str) -> str:
        calls = [
            node for node in nodes(self._user) if isinstance(node, ast.Call) and node.name == state
        ]
        return seconds(onset(self._evaluator, calls, self._env))


def _words(env: Env, witness: Witness, verdict: Finding) -> dict[str, str]:
    return {
        **_bodies(env),
        "signal": witness.signal,
        "value": measured(witness.value, witness),
        "limit": measured(witness.limit, witness),
        "margin": measured(None if witness.margin is None else abs(witness.margin), witness),
        "time": seconds(verdict.time),
        "t.worst": seconds(verdict.worst_time),
        "t.first": seconds(verdict.time),
    }
