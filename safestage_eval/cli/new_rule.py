"""A first rule about a signal: a commented file, and two scenes on either side of its limit."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np

from safestage_eval.errors import InputError, did_you_mean
from safestage_eval.evidence.declare import Signal
from safestage_eval.rules import builtin_names, load_rules
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.files import builtin_folder
from safestage_eval.rules.names import a_dimension
from safestage_eval.rules.uses import own_params, uses_of
from safestage_eval.signals import SIGNALS
from safestage_eval.sketch import read
from safestage_eval.units import format_quantity
from safestage_eval.verdicts.ask import ask

ENOUGH = 6
"""The search for two scenes ends when so many of one cast differ in the signal."""

LOOKED_AT = 20
"""It also ends after so many scenes if at least two of one cast differ."""

RULE = """\
# A rule about {name}: {meaning}
# "safestage rules check {file}" says what is wrong with it, "safestage rules test {file}" judges its two scenes,
# "safestage rules show {file}" says it back in words. The language: docs/rules.md.

[ruleset]
format  = 1                      # of the language
name    = "{stem}"
version = "1.0.0"
extends = ["defaults"]           # shared parameters, states and phases, which may be overridden here

[param]
{limit} = "{value}"              # {dimension}; "safestage sweep" tries other values

[[rule]]
code    = "{code}"               # three capital letters for the stage, three digits
title   = "Keep {name} {word} {value}"
why     = "Say in one sentence what goes wrong otherwise."
roles   = {{ {roles} }}          # who takes part; "every object tagged fragile" needs no binding
# during = "execution"           # the frames that are judged; left out, all of them
require = {{ "{call}" = "{op} {limit}" }}
explain = "{{signal}} was {{value}} at {{t.worst}}; the limit is {{limit}}."

[rule.examples]                  # scenes in the folder examples beside this file: docs/sketches.md
passes   = ["{stem}_passes"]
violates = ["{stem}_violates"]
"""


class Measured(NamedTuple):
    """A scene, and the worst value of a signal in it."""

    worst: float
    path: Path


def write_rule(path: Path, signal: str, code: str) -> list[Path]:
    """Write a rule file and its two scenes; the paths of all three.

    Raises InputError for no such signal, one without fitting scenes, or a file that is there already.
    """
    spec = SIGNALS.get(signal)
    if spec is None:
        raise InputError(
            signal, "no such signal.", ", ".join(SIGNALS), did_you_mean(signal, SIGNALS)
        )
    op = _operator(signal)
    roles, good, bad = _scenes(spec, op)
    call = f"{signal}({', '.join(roles)})"
    value = _between(good.worst, bad.worst, spec.dimension)
    scenes = path.parent / "examples"
    files = {
        path: RULE.format(
            name=signal, meaning=" ".join(spec.meaning.split()), file=path, stem=path.stem, code=code,
            limit=f"{signal}_limit", value=value, dimension=a_dimension(spec.dimension), call=call,
            op=op, word="above" if op == ">=" else "below",
            roles=", ".join(f'{role} = "{_kind(spec)}"' for role in roles if role != "robot"),
        ),
        scenes / f"{path.stem}_passes.toml": good.path.read_text("utf-8"),
        scenes / f"{path.stem}_violates.toml": bad.path.read_text("utf-8"),
    }  # fmt: skip
    for file in files:
        if file.exists():
            raise InputError(str(file), "is there already.", "", "another name")
    scenes.mkdir(parents=True, exist_ok=True)
    for file, text in files.items():
        file.write_text(text, "utf-8")
    return list(files)


def _kind(spec: Signal) -> str:
    return "joint" if spec.joints else "object"


def _operator(signal: str) -> str:
    """On which side of a limit the built-in rules keep a signal; below where none speaks of it."""
    rules = load_rules(builtin_names())
    clauses = [
        (clause.what, clause.kind != "forbid")
        for rule in rules.rules.values()
        for clause in rule.clauses
    ]
    for states in (False, True):  # what a rule says itself comes before what its states say
        for what, wanted in clauses:
            for op, kept in _limits(rules, what, signal, wanted=wanted, states=states):
                return (op if kept else _OTHER_SIDE[op]) + "="
    return "<="


_OTHER_SIDE = {"<": ">", ">": "<"}


def _limits(
    rules: ast.RuleSet, what: ast.Alternative, signal: str, *, wanted: bool, states: bool
) -> Iterator[tuple[str, bool]]:
    """The sides of a signal's limits in a condition, and whether that is how it is wanted."""
    for atom in what.atoms if isinstance(what, ast.Condition) else ():
        if isinstance(atom, ast.SignalAtom) and atom.call.name == signal and atom.limits:
            yield atom.limits[0].op[0], wanted
        elif isinstance(atom, ast.AnyOf):
            for one in atom.alternatives:
                yield from _limits(rules, one, signal, wanted=wanted, states=states)
        elif states and isinstance(atom, ast.StateAtom) and atom.call.name in rules.states:
            when, same = rules.states[atom.call.name].when, wanted is atom.want
            yield from _limits(rules, when, signal, wanted=same, states=True)


def _scenes(spec: Signal, op: str) -> tuple[tuple[str, ...], Measured, Measured]:
    """The roles of a rule, and two scenes that differ in the signal: the one that is kept apart and the other."""
    measured: dict[tuple[str, ...], list[Measured]] = {}
    for number, (roles, scene) in enumerate(_measured(spec, op)):
        if number >= LOOKED_AT and max(map(len, measured.values())) > 1:
            break
        cast = measured.setdefault(roles, [])
        if all(abs(one.worst - scene.worst) > 0.1 * abs(scene.worst) + 1e-3 for one in cast):
            cast.append(scene)
        if len(cast) >= ENOUGH:
            break
    roles = max(measured, key=lambda one: len(measured[one]), default=())
    if len(measured.get(roles, ())) < 2:
        raise InputError(
            spec.name, "no two built-in scenes differ in it.",
            "a signal of one or two bodies; one that needs options is declared as [signal.NAME] first",
            "see docs/sketches.md for scenes of your own",
        )  # fmt: skip
    ordered = sorted(measured[roles])
    ordered = ordered[::-1] if op == "<=" else ordered  # the worst first: most scenes are to pass
    first = max(1, len(ordered) // 4)
    return roles, ordered[first], ordered[first - 1]


def _measured(spec: Signal, op: str) -> Iterator[tuple[tuple[str, ...], Measured]]:
    """Roles and the worst value, of each built-in scene that can be asked; the likeliest scenes first."""
    folder = builtin_folder() / "examples"
    told = [f"{name.partition('(')[0]}.toml" for name in _examples_about(spec.name)]
    every = [folder / name for name in told] + sorted(folder.glob("*.toml"))
    for path in dict.fromkeys(every):
        episode = read(path)
        header, kinds = episode.header, {body.name: body.kind for body in episode.header.bodies}
        names = set(kinds) if not spec.joints else {joint.name for joint in header.joints}
        cast = [
            role for role, players in header.roles.items()
            if len(players) == 1 and players[0] in names and kinds.get(players[0], "object") == "object"
        ]  # fmt: skip
        if spec.groups and len(spec.args) - spec.optional == 2 and cast:
            cast.insert(0, "robot")
        roles = tuple(cast[: len(spec.args) - spec.optional])
        try:
            series = ask(episode, f"{spec.name}({', '.join(roles)})")
        except InputError:
            continue
        worst = float(np.max(series.upper) if op == "<=" else np.min(series.lower))
        if np.isfinite(worst):
            yield roles, Measured(worst, path)


def _examples_about(signal: str) -> list[str]:
    """The scenes that rules name whose verdicts hang on a signal."""
    rules = load_rules(builtin_names())
    return [
        name
        for rule in rules.rules.values()
        if signal in uses_of(rules, rule, own_params(rules, rule)).signals
        for pair in zip_longest(rule.passes, rule.violates)
        for name in pair
        if name is not None
    ]


def _between(good: float, bad: float, dimension: str) -> str:
    """A limit between two values, in as few digits as tell it from both."""
    for digits in range(4):
        text = format_quantity((good + bad) / 2, dimension, digits)
        if text.split()[0] not in (
            format_quantity(good, dimension, digits).split()[0],
            format_quantity(bad, dimension, digits).split()[0],
        ):
            return text
    return format_quantity((good + bad) / 2, dimension, 6)
