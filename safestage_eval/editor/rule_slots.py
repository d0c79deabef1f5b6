"""Kinds of values that the rule language expects at a path of keys: ``("rule", 0, "during")``: a span."""

from __future__ import annotations

from dataclasses import dataclass

from safestage_eval.rules.locate import Keys
from safestage_eval.rules.table_keys import NAMED, REPEATED, TABLES


@dataclass(frozen=True)
class Slot:
    """One place of the language.

    Attributes:
        kind: a kind of ``keys.Key``; ``table NAME`` where the keys of a table stand; ``entry`` for the limit
            or truth of an entry of a condition; ``top`` for the top of a file.
        name: the key that it is the value of.
        owner: the way to the rule, state, … around it.
    """

    kind: str
    name: str = ""
    owner: Keys = ()


def slot_at(path: Keys) -> Slot | None:
    """The slot at the end of a way; None where the language has none."""
    if not path:
        return Slot("top")
    kind, *rest = path
    if kind in ("ruleset", "baseline"):
        return _in_table(str(kind), rest, (kind,))
    if kind in ("param", "material"):
        depth = {"param": 1, "material": 2}[str(kind)]
        if len(rest) == depth:
            return Slot("setting", str(rest[-1]), path)
        return Slot(f"table {kind}", owner=path) if len(rest) < depth else None
    if kind in (*NAMED, *REPEATED) and rest:
        return _in_table(str(kind), rest[1:], (kind, rest[0]))
    return None


def _in_table(kind: str, rest: list[str | int], owner: Keys) -> Slot | None:
    if not rest:
        return Slot(f"table {kind}", owner=owner)
    key = TABLES[kind].get(str(rest[0]))
    return None if key is None else _in_value(key.kind, str(rest[0]), rest[1:], owner)


_ITEMS = {
    "texts": "texts", "names": "names", "alternatives": "alternative", "operands": "operand",
    "players": "players", "goal table": "goal table",
}  # fmt: skip
"""Kind of a list → kind of its items."""


def _in_value(kind: str, name: str, rest: list[str | int], owner: Keys) -> Slot | None:
    if not rest:
        return Slot(kind, name, owner)
    first, *below = rest
    if isinstance(first, int):
        if kind == "charges":
            return _in_table("charge", below, owner)
        return _in_value(_ITEMS[kind], name, below, owner) if kind in _ITEMS else None
    match kind:
        case "condition" | "alternative" | "alternatives":
            if first == "any":
                return _in_value("alternatives", first, below, owner)
            if below and isinstance(below[0], int):  # several limits
                below = below[1:]
            return None if below else Slot("entry", first, owner)
        case "examples":
            return _in_table("examples", rest, owner)
        case "roles":
            return None if below else Slot("role", first, owner)
        case "settings":
            return None if below else Slot("setting", first, owner)
        case "levels":
            return _in_value("settings", first, below, owner)
    return None
