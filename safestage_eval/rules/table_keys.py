"""The tables of rule files and bind files, and the keys of each: as the syntax tree declares them."""

from __future__ import annotations

from safestage_eval.signals import SIGNALS

from . import syntax as ast
from .body_facts import BodyFacts
from .keys import Key, Kind, keys_of
from .operations import OPERATIONS

_KIND_OF_OPTION: dict[str, Kind] = {
    "time": "duration", "length": "length", "channel": "channel", "unit": "text", "box": "box",
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


def _judged(declared: type[ast.Scoped]) -> dict[str, Key]:
    return {**keys_of(declared), "examples": Key("examples", "Episodes that it must call right.")}


TABLES: dict[str, dict[str, Key]] = {
    "ruleset": keys_of(ast.Head),
    "baseline": {"span": Key("span", "The frames that are the initial state.", True)},
    "signal": {
        "base": Key("base", "The built-in signal that this is a variant of."),
        **_option_keys(),
        "of": Key("names", "Formal arguments of a signal that is computed from others."),
        **{name: Key("operands", operation.meaning) for name, operation in OPERATIONS.items()},
    },
    "state": keys_of(ast.StateDef),
    "phase": keys_of(ast.PhaseDef),
    "goal": keys_of(ast.GoalDef),
    "bound": keys_of(ast.TaskDef),
    "described": keys_of(BodyFacts),
    "rule": _judged(ast.Rule),
    "cost": _judged(ast.Cost),
    "charge": keys_of(ast.Charge),
    "examples": keys_of(ast.Rule, "examples"),
}
"""Table → its keys. ``param`` and ``material`` hold names of the author's choice; ``IN_BIND`` are tables
of a bind file."""

APART = {
    "rule": (("at", "during"), ("at", "until")),
    "cost": (("at", "during"), ("at", "until")),
    "charge": (("when", "of"), ("when", "above"), ("when", "below"), ("above", "below")),
}
"""Table → pairs of keys that do not go together."""

GONE = {
    "family": "a bind file: rules and set under [task.NAME] of each of its tasks, or under [every]",
    "task": "a bind file, where [task.NAME] says the same: --bind FILE",
    "charge.whole": "two charges: what exceeds above, and `when` it is exceeded, add = above",
    "signal.sum": "difference, with a product by -1 for what shall be added",
    "signal.quotient": "product by a constant, or a limit on what was divided, times the divisor",
    "signal.min": "two limits in one condition",
    "signal.max": "any = [...] of two limits",
    "signal.root": "a limit on the square, or magnitude",
}
"""Tables and keys that the language had → what says it now."""

IN_BIND = ("bound", "described")
"""Keys that bind an episode and describe bodies."""

NAMED = ("signal", "state", "phase", "goal")
"""Tables with one sub-table per name: ``[state.NAME]``."""

REPEATED = ("rule", "cost")
"""Arrays of tables: ``[[rule]]``."""

TOP = ("ruleset", "baseline", "param", "material", *NAMED, *REPEATED)
"""Everything that may stand at the top of a file."""
