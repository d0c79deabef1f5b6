"""One sentence per finding: what, when, by how much and why."""

from __future__ import annotations

import re
import string
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from safestage_eval._text.plural import first_few
from safestage_eval.episode.runs import runs
from safestage_eval.rules import string_parser, syntax_words
from safestage_eval.rules import syntax as ast
from safestage_eval.units import format_quantity, told_apart

from .evaluate import Evaluator
from .language import Env
from .obligations import OBLIGATIONS, Instance
from .players import field_names, mentions, nodes
from .verdict import VerdictName
from .witness import Witness


class Finding(NamedTuple):
    """Parts of a verdict's sentence besides the witness; fields as in ``Verdict``."""

    verdict: VerdictName
    time: float | None
    worst_time: float | None
    margin: float | None


_BOUNDS = {
    ">=": "at least {} is required",
    ">": "more than {} is required",
    "<=": "at most {} is allowed",
    "<": "less than {} is allowed",
}

_UNMEASURED = re.compile(
    r"\{signal\} (was|reached) \{value\}(?P<at> at \{[\w.]+\})?(; the limit is \{limit\})?"
)
"""Templates for measurements; relations have none."""


def inconclusive(cause: str, remedy: str = "") -> str:
    """``Cannot be decided: CAUSE. REMEDY.``: the sentence of an inconclusive verdict."""
    end = "" if cause.endswith(("?", ".")) else "."
    remedy = f" {remedy[:1].upper()}{remedy[1:]}." if remedy else ""
    return f"Cannot be decided: {cause}{end}{remedy}"


def cause_and_remedy(explanation: str) -> tuple[str, str]:
    """Cause and remedy given to ``inconclusive``, without full stops; ("", "") for other sentences."""
    match = re.fullmatch(
        r"Cannot be decided: (.+?)\.?(?: ([A-Z](?:[^.]|\.(?=\S))*)\.)?", explanation
    )
    cause, remedy = match.groups(default="") if match else ("", "")
    return cause, remedy[:1].lower() + remedy[1:]


def seconds(time: float | None) -> str:
    """A time as sentences say it; None is ``never``."""
    return "never" if time is None else f"{time:.2f} s"


def worded(text: str) -> str:
    """A filled template in which moments read as such.

    What did not happen: ``moved at never`` → ``never moved``. What began, where others measure a
    value: ``lost(bottle) was 4.48 s at 4.48 s`` → ``lost(bottle) began at 4.48 s``.
    """
    text = re.sub(r"\b(\w+) at never\b", r"never \1", text)
    return re.sub(r"\bwas (\d+\.\d\d s) at \1", r"began at \1", text)


def measured(value: float | None, witness: Witness) -> str:
    """A value of the witness's dimension with its unit; one that is not finite as ∞ or −∞."""
    if witness.dimension is None:
        return "–"
    if value is None:
        return "never" if witness.dimension == "time" else _beyond(witness)
    known = format_quantity(value, witness.dimension)
    if (
        witness.value is not None
        and witness.limit is not None
        and value in (witness.value, witness.limit)
    ):
        pair = told_apart(witness.value, witness.limit, witness.dimension)
        known = pair[0] if value == witness.value else pair[1]
    return f"{known} or more" if witness.at_least and value == witness.value else known


def _beyond(witness: Witness) -> str:
    """The infinite value that breaks a limit."""
    return "−∞" if witness.needs.startswith(">") else "∞" if witness.needs else "–"


def bound(witness: Witness) -> str:
    """On which side of its limit a value must lie: ``at least 8.0 cm is required``."""
    limit = measured(witness.limit, witness)
    return _BOUNDS[witness.needs].format(limit) if witness.needs else f"the limit is {limit}"


def sentence(
    evaluator: Evaluator,
    rule: ast.Scoped,
    env: Env,
    witness: Witness,
    verdict: Finding,
) -> str:
    """The sentence of a violation, or of a pass that a measurement decides; empty if none does.

    Of a violation the rule's own ``explain``, or that of the state that decided it, filled in.
    """
    if verdict.verdict == "violation":
        return _violated(evaluator, rule, env, witness, verdict)
    if witness.dimension == "time":
        return _in_order(witness, verdict.verdict)
    return "" if verdict.margin is None else passed(witness, verdict.worst_time)


def _violated(
    evaluator: Evaluator, rule: ast.Scoped, env: Env, witness: Witness, verdict: Finding
) -> str:
    if witness.state is not None:
        return worded(_of_state(evaluator, witness.state, env))
    if witness.dimension is None:
        moment = witness.signal.startswith(("start of ", "end of "))
        held, not_held = ("came", "did not come") if moment else ("held", "did not hold")
        seen = f"{{signal}} {held if witness.needs == 'false' else not_held}"
        text = _UNMEASURED.sub(rf"{seen}\g<at>", rule.explain) or f"{seen} at {{time}}."
    elif rule.explain:
        text = rule.explain
    elif witness.dimension == "time":
        return _in_order(witness, verdict.verdict)
    else:
        text = f"{{signal}} was {{value}} at {{t.worst}}; {bound(witness)}."
    words = _words(env, witness, verdict)
    after = float(evaluator.episode.t[witness.frame])
    return worded(_Template(evaluator, rule, env, words, after).format(text))


def _in_order(witness: Witness, verdict: VerdictName) -> str:
    """When something began that had to wait, and from when on it was allowed."""
    if witness.value is None:
        return f"{witness.signal} never began."
    allowed = "; it was never allowed" if verdict == "violation" else ""
    if witness.limit is not None:
        allowed = f"; it was allowed from {seconds(witness.limit)} on"
    return f"{witness.signal} began at {seconds(witness.value)}{allowed}."


def passed(witness: Witness, time: float | None, others: int = 0) -> str:
    """The sentence of a pass: how near its closest measurement came to its limit, and when.

    Args:
        witness: the measurement.
        time: s, of it.
        others: combinations of bodies that came as near.
    """
    alike = f", {others} other{'s' * (others > 1)} tied" if others else ""
    if witness.tied:
        alike = ", others tied"
    value = measured(witness.value, witness)
    if untouched(witness):
        limit = measured(witness.limit, witness)
        return f"No contact{alike}: {witness.said} was {value}; {limit} would be one."
    when = f"{witness.said} was {value} at {seconds(time)}"
    return f"Closest to the limit{alike}: {when}; {bound(witness)}."


def untouched(witness: Witness) -> bool:
    """The measurement is a contact force of zero: the bodies did not touch at all."""
    return witness.name == "contact_force" and witness.value == 0


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
    begun = [first for call in calls for first, _ in runs(evaluator.holds(call, env))]
    frames = [int(first) for first in begun if first >= earliest]
    return float(t[min(frames)]) if frames else None


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
            call = string_parser.call(field_name.removeprefix("next."))
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
        "signal": witness.said,
        "value": measured(witness.value, witness),
        "limit": measured(witness.limit, witness),
        "margin": measured(None if witness.margin is None else abs(witness.margin), witness),
        "time": seconds(verdict.time),
        "t.worst": seconds(verdict.worst_time),
        "t.first": seconds(verdict.time),
    }


# ---- obligations and scopes in words, with the names of the bodies

MOST = 4
"""Bodies of a role that are listed; of more only the number is."""


def kept(evaluator: Evaluator, clause: ast.Clause, instances: Sequence[Instance]) -> str:
    """The sentence of a pass that no single measurement decides: what held, of whom, and when."""
    first = min(i.scope.first for i in instances)
    stop = max(i.scope.stop for i in instances)
    return OBLIGATIONS[clause.kind].kept.format(
        begin=seconds(float(evaluator.episode.t[first])),
        end=seconds(evaluator.clock.end_of(stop)),
        what=condition(evaluator, clause.what, [i.env for i in instances]).removeprefix("the "),
    )


def unmet(evaluator: Evaluator, rule: ast.Rule, clause: ast.Clause, instance: Instance) -> str:
    """The sentence of a violation that no measurement decides: what did not come, and when."""
    what = condition(evaluator, clause.what, [instance.env])
    return f"Never reached in {scope(evaluator, rule, instance.env)}: {what}."


def scope(evaluator: Evaluator, rule: ast.Scoped, env: Env) -> str:
    """When a rule is judged: ``hold``, ``from the start of taken(cup) to success``."""
    if rule.at is not None:
        return syntax_words.event(with_bodies(rule.at, env, evaluator))
    return syntax_words.span(
        with_bodies(rule.during or ast.Whole(), env, evaluator), evaluator.params
    )


def condition(evaluator: Evaluator, what: ast.Alternative, envs: Sequence[Env]) -> str:
    """A condition or event on one or several combinations of bodies."""
    several = len({tuple(env.items()) for env in envs}) > 1
    part = what if several else with_bodies(what, envs[0], evaluator)
    sole = part.atoms[0] if isinstance(part, ast.Condition) and len(part.atoms) == 1 else None
    parts = sole.alternatives if isinstance(sole, ast.AnyOf) else (part,)
    texts = [syntax_words.alternative(one, evaluator.params) for one in parts]
    if len(texts) > 1:
        texts = [f"({text})" if " and " in text else text for text in texts]
    text = " or ".join(texts)
    if not several:
        return text
    bodies = {
        role: dict.fromkeys(env[role] for env in envs) for role in envs[0] if mentions(what, role)
    }
    return f"{text} ({'; '.join(f'{role}: {first_few([*names], MOST)}' for role, names in bodies.items())})"


def with_bodies(node: Any, env: Env, evaluator: Evaluator) -> Any:
    """A part of a rule with names of bodies in place of roles, and values in place of columns."""
    if isinstance(node, tuple):
        return tuple(with_bodies(item, env, evaluator) for item in node)
    if isinstance(node, ast.Call):
        return replace(node, args=tuple(env.get(arg, arg) for arg in node.args))
    if isinstance(node, ast.Column):
        dimension = evaluator.rules.materials["default"][node.name].dimension
        value = evaluator.number(node, env)
        name = f"{node.name} of {env.get(node.role, node.role)}"
        return ast.Quantity(value, dimension, f"{format_quantity(value, dimension)} ({name})")
    names = field_names(type(node))
    if not names:
        return node
    return replace(
        node, **{name: with_bodies(getattr(node, name), env, evaluator) for name in names}
    )
