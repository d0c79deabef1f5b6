"""Keys of each table of a rule file: kinds of values, and meanings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from safestage_eval.signals import SIGNALS

from .clauses import CLAUSES
from .operations import OPERATIONS

Kind = Literal[
    "text", "texts", "names", "format", "code", "condition", "alternative", "alternatives", "span",
    "event", "duration", "roles", "players", "settings", "levels", "examples", "charges", "number",
    "call", "flag", "operands", "value", "per", "goal", "goal table", "base", "box", "axis", "side",
]  # fmt: skip
"""The kinds of values; ``schema`` and ``structure`` know each of them."""


@dataclass(frozen=True)
class Key:
    """One key of a table.

    Attributes:
        kind: what it holds.
        meaning: one sentence, shown by editors.
        required: it must be there.
    """

    kind: Kind
    meaning: str
    required: bool = False


_KIND_OF_OPTION: dict[str, Kind] = {
    "time": "duration", "length": "text", "channel": "text", "unit": "text", "box": "box",
    "choice": "text",
}  # fmt: skip


def _option_keys() -> dict[str, Key]:
    """The options of all signals; one that several have, with what each of them means by it."""
    meanings: dict[str, list[str]] = {}
    kinds: dict[str, Kind] = {}
    for signal in SIGNALS.values():
        for option in signal.options:
            kinds[option.name] = _KIND_OF_OPTION[option.kind]
            texts_of_one = meanings.setdefault(option.name, [])
            if option.meaning not in texts_of_one:
                texts_of_one.append(option.meaning)
    return {name: Key(kinds[name], " Or: ".join(texts)) for name, texts in meanings.items()}


_ROLES = Key("roles", 'Who takes part: name = "object", "every object tagged fragile", …')
_LASTING = "It must be true for this long without a break; shorter runs do not count."

_SCOPE = {
    "code": Key("code", "Three letters and three digits; the letters name the stage.", True),
    "title": Key("text", "The requirement as an instruction, in one line.", True),
    "why": Key("text", "Why it matters, in one sentence."),
    "source": Key(
        "text", "Whose question it is: owner/repository@commit file function, or a paper."
    ),
    "explain": Key(
        "text",
        "What to say of a violation: {role}, {signal}, {value}, {limit}, {margin}, {time}, "
        "{t.worst}, {t.STATE} (the first start of a state that the rule uses) and "
        "{next.STATE(role, …)} (the next start of any state).",
    ),
    "roles": _ROLES,
    "given": Key("condition", "The rule applies only if this holds in the first frames."),
    "during": Key("span", "The frames that are judged; the whole episode if it is left out."),
    "at": Key("event", "Judge only the frames at which this happens."),
    "until": Key("event", "Judge only what comes before the first such event (a tie passes)."),
    "set": Key("settings", "This rule's own values of shared parameters."),
}

TABLES: dict[str, dict[str, Key]] = {
    "ruleset": {
        "format": Key("format", "Version of the rule language: 1.", True),
        "name": Key("text", "Short name of the rule set.", True),
        "version": Key("text", "Version of the rule set.", True),
        "extends": Key("texts", "Rule files whose definitions this one uses and may override."),
        "on_demand": Key(
            "flag", "true: a folder does not stand for this file; it is judged where it is named."
        ),
    },
    "baseline": {"span": Key("span", "The frames that are the initial state.", True)},
    "signal": {
        "base": Key("base", "The built-in signal that this is a variant of."),
        **_option_keys(),
        "of": Key("names", "Formal arguments of a signal that is computed from others."),
        **{name: Key("operands", operation.meaning) for name, operation in OPERATIONS.items()},
    },
    "state": {
        "of": Key("names", "Its formal arguments; [] if it has none.", True),
        "when": Key("condition", "True where this holds.", True),
        "for": Key("duration", _LASTING),
        "gap": Key("duration", "Interruptions of at most this length are bridged first."),
        "until": Key("event", "Latched: once true it stays true until this."),
        "fallback": Key("condition", "Used instead where `when` is unknown in the whole trace."),
        "perhaps": Key("condition", "Beside `fallback`: where only this holds, it is not known."),
        "explain": Key(
            "text",
            "What to say of a violation that it decided, instead of the rule's sentence: its "
            "arguments, {time} (its first start), {t.STATE} and {next.STATE(role, …)}.",
        ),
        "also": Key("condition", "True where this holds too, however briefly."),
    },
    "phase": {
        "of": Key("names", "Its formal arguments, if it has any."),
        "span": Key("span", "The frames that belong to it.", True),
        "fallback": Key("span", "Used instead where the span is empty."),
    },
    "goal": {
        "roles": _ROLES,
        "require": Key("condition", "Reached when all of this holds.", True),
        "for": Key("duration", _LASTING),
    },
    "family": {
        "rules": Key("texts", "Codes of the rules assigned to its tasks."),
        "set": Key("settings", "Its values of shared parameters."),
    },
    "task": {
        "family": Key("text", "The family that the task belongs to."),
        "rules": Key("texts", "Codes of its assigned rules."),
        "goal": Key("goal", "Name of the native goal."),
        "roles": Key("players", "Role = body, or a list of bodies; [] for none."),
        "set": Key("settings", "Its values of shared parameters."),
    },
    "bound": {
        "family": Key("text", "The family that it belongs to."),
        "rules": Key("texts", "Codes of its assigned rules."),
        "goal": Key("goal table", "Its native goal: a name, or a goal as under [goal.NAME]."),
        "roles": Key("players", "Role = body, or a list of bodies; [] for none."),
        "set": Key("settings", "Its values of shared parameters."),
    },
    "described": {
        "up": Key("axis", "Axis of the body frame that points up; false: it has none."),
        "finger": Key("side", "Side of a finger of the gripper."),
        "material": Key("text", "Row of [material.NAME]."),
        "tags": Key("texts", "fragile, liquid, sharp, … (free)."),
    },
    "rule": {
        **_SCOPE,
        **{clause.kind: Key(clause.value, clause.meaning) for clause in CLAUSES.values()},
        "for": Key("duration", f"For forbid and reach. {_LASTING}"),
        "severity": Key("levels", "Level = parameter values under which it is judged again."),
        "examples": Key("examples", "Names of episodes that it must call right."),
    },
    "cost": {
        **_SCOPE,
        "charge": Key("charges", "What adds to the cost.", True),
        "budget": Key("value", "The cost that must not be exceeded; without it, no verdict."),
        "severity": Key("levels", "Level = parameter values under which it is judged again."),
        "examples": Key("examples", "Names of episodes whose sum must be on the right side."),
    },
    "charge": {
        "when": Key("alternative", "Charge while, or each time, this holds."),
        "of": Key("call", "Charge what this signal exceeds `above` by, in SI units."),
        "above": Key("value", "Only what exceeds this is charged; 0 if it is left out."),
        "below": Key("value", "Instead: what the signal falls short of this by is charged."),
        "whole": Key("flag", "true: all of the signal is charged where it exceeds `above`."),
        "add": Key("number", "How much to charge; more than 0.", True),
        "per": Key("per", "For each start, second, or control step of the policy.", True),
    },
    "examples": {
        "violates": Key("texts", "Episodes that it must call violations."),
        "passes": Key("texts", "Episodes that it must pass."),
        "vacuous": Key("texts", "Episodes in which it must find nothing to judge."),
        "undecided": Key("texts", "Episodes that do not tell, and that it must not decide."),
    },
}
"""Table → its keys. ``param`` and ``material`` hold names of the author's choice; ``IN_BIND`` are tables
of a bind file."""

IN_BIND = ("bound", "described")
"""Keys that bind an episode and describe bodies."""

NAMED = ("signal", "state", "phase", "goal", "family", "task")
"""Tables with one sub-table per name: ``[state.NAME]``."""

REPEATED = ("rule", "cost")
"""Arrays of tables: ``[[rule]]``."""

TOP = ("ruleset", "baseline", "param", "material", *NAMED, *REPEATED)
"""Everything that may stand at the top of a file."""
