"""Checks of tables in rule files: required keys, unknown keys, types of values."""

from __future__ import annotations

import re
from typing import Any

from . import string_parser
from .condition_checks import Usage
from .locate import Keys
from .names import RESERVED, Near
from .table_keys import IN_BIND, TABLES, Key

CODE = "[A-Z]{3}[0-9]{3}"
"""A rule's code: three letters for its stage or benchmark, three digits."""

FORMAT = 1
"""Version of the rule language that this SafeStage reads."""

_TYPES: dict[str, tuple[type | tuple[type, ...], str]] = {
    "text": (str, "text in quotes"),
    "axis": ((list, bool), "[0, 0, 1], or false where it has none"),
    "side": (str, '"left" or "right"'),
    "base": (str, "the name of a built-in signal, in quotes"),
    "box": (list, '[["-50 cm", "-1 m", "0 m"], ["1 m", "1 m", "1.5 m"]]'),
    "code": (str, 'text in quotes: "ETS101"'),
    "goal": (str, "the name of a goal, in quotes"),
    "goal table": ((str, dict), "the name of a goal, or { roles = { … }, require = { … } }"),
    "span": (str, 'a span in quotes: "last 1 s of hold"'),
    "event": (str, 'an event in quotes: "success", "start of moved(target)"'),
    "duration": (str, 'a duration in quotes: "0.5 s", "3 frames @ 120 Hz"'),
    "call": (str, 'a signal in quotes: "contact_force(robot, protected)"'),
    "operands": ((str, list), '["displacement(a)", "2 cm"], or one signal in quotes'),
    "flag": (bool, "true or false"),
    "per": (str, '"start", "second" or "step"'),
    "condition": (dict, '{ "moved(target)" = true }'),
    "alternative": ((str, dict), '"moved(target)" or { "speed(target)" = ">= 5 cm/s" }'),
    "alternatives": ((str, dict, list), '"moved(target)", a condition, or a list of both'),
    "texts": (list, '["…", "…"]'),
    "names": (list, '["a", "b"]'),
    "charges": (list, '[{ when = "…", add = 1, per = "start" }]'),
    "roles": (dict, '{ target = "object" }'),
    "players": (dict, '{ target = "mug", protected = ["vase", "phone"] }'),
    "settings": (dict, '{ edge = "3 cm" }'),
    "levels": (dict, '{ serious = { edge = "1 cm" } }'),
    "examples": (dict, '{ violates = ["…"], passes = ["…"] }'),
    "number": ((int, float), "a number"),
    "format": (int, f"{FORMAT}"),
    "value": ((str, int, float), '"5 N", a parameter, or a number'),
}


def table(usage: Usage, kind: str, table: Any, keys: Keys) -> dict[str, Any]:
    """The entries of a table that have the right type; all other problems are reported."""
    spec = TABLES[kind]
    label = f"[[{kind}]]" if kind in ("rule", "cost") else f"[{kind}]"
    label = f"[{keys[0]}.NAME]" if kind in IN_BIND else label
    label = "[every]" if keys == ("every",) else label
    if not isinstance(table, dict):
        usage.report(
            "R203", keys, f"{'.'.join(map(str, keys))} must be a table", f"{label} and its keys"
        )
        return {}
    good = {}
    for name, value in table.items():
        at = (*keys, name)
        if name not in spec:
            usage.report(
                "R201", at, f'{label} has no key "{name}"', ", ".join(spec), Near(name, spec),
                key=True,
            )  # fmt: skip
        elif _fits(usage, spec[name], value, at):
            good[name] = value
    for name, key in spec.items():
        if key.required and name not in table:
            usage.report(
                "R202", keys, f'{label} needs "{name}"', f"{name} = {_example(key)}", key=True
            )
    return good


def players(usage: Usage, table: dict[str, Any], keys: Keys) -> None:
    """Each role of a task is played by one body, several, or (an empty list) none."""
    for role, players in table.get("roles", {}).items():
        bodies = players if isinstance(players, list | tuple) else [players]
        if not all(isinstance(body, str) for body in bodies):
            usage.report(
                "R203", (*keys, "roles", role), "a role is played by one body or a list of them",
                '"mug", ["vase", "phone"], or [] for no body',
            )  # fmt: skip


def declared_name(usage: Usage, name: str, keys: Keys) -> None:
    """A name of the author's choice must be spelled as names are, and be no word of the language."""
    if not re.fullmatch(string_parser.NAME, name):
        usage.report(
            "R210", keys, f'"{name}" cannot be a name',
            "a small letter, then small letters, digits and underscores", key=True,
        )  # fmt: skip
    elif name in RESERVED:
        usage.report(
            "R210", keys, f'"{name}" is a word of the rule language', "another name", key=True
        )


def _fits(usage: Usage, key: Key, value: Any, keys: Keys) -> bool:
    types, allowed = _TYPES[key.kind]
    wrong = ""
    if key.kind == "axis":
        wrong = "" if _is_axis(value) else f'"{keys[-1]}" is no axis'
    elif key.kind == "side" and value not in ("left", "right"):
        wrong = f'"{keys[-1]}" is no side'
    elif isinstance(value, bool) != (types is bool) or not isinstance(value, types):
        wrong = f'"{keys[-1]}" has a value of the wrong type'
    elif key.kind == "code" and not re.fullmatch(CODE, str(value)):
        wrong = f'"{value}" is not a code'
        allowed = "three capital letters and three digits: ETS101"
    elif key.kind == "per" and value not in ("start", "second", "step"):
        wrong = f'nothing can be charged per "{value}"'
    if wrong:
        usage.report("R203", keys, wrong, allowed)
        return False
    if key.kind == "format" and value != FORMAT:
        usage.report(
            "R103", keys, f"this is format {value} of the rule language", str(FORMAT),
            "use a SafeStage that knows it",
        )  # fmt: skip
        return False
    if key.kind in ("texts", "names"):
        return _texts(usage, key.kind, value, keys)
    return True


def _is_axis(value: Any) -> bool:
    """False, or three numbers that are not all zero."""
    if not isinstance(value, list):
        return value is False
    numbers = [part for part in value if isinstance(part, int | float) and abs(part) < 1e308]
    return len(numbers) == len(value) == 3 and any(numbers)


def _texts(usage: Usage, kind: str, items: Any, keys: Keys) -> bool:
    good = True
    for index, item in enumerate(items):
        if not isinstance(item, str):
            usage.report("R203", (*keys, index), "only text in quotes may stand in this list")
            good = False
        elif kind == "names" and not re.fullmatch(string_parser.NAME, item):
            declared_name(usage, item, (*keys, index))
            good = False
    return good


def _example(key: Key) -> str:
    return _TYPES[key.kind][1]
