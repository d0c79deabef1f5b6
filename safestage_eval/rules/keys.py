"""The keys of a table, declared beside the field of the syntax tree that holds what they say."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, Literal

Kind = Literal[
    "text", "texts", "names", "format", "code", "condition", "alternative", "alternatives", "span",
    "event", "duration", "roles", "players", "settings", "levels", "examples", "charges", "number",
    "call", "flag", "operands", "value", "budget", "per", "goal table", "base", "box", "length", "channel", "axis", "side",
    "codes", "sentence",
]  # fmt: skip
"""The kinds of values; ``KINDS`` of ``tables`` and the schema know each of them."""


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


def key(kind: Kind, meaning: str, *, required: bool = False, table: str = "", **given: Any) -> Any:
    """A field that a key of its own name fills, in the table itself or in a ``table`` inside."""
    return field(metadata={"key": Key(kind, meaning, required), "table": table}, **given)


def keys_of(declared: type, table: str = "") -> dict[str, Key]:
    """Key → what it holds, in the order of the fields; ``for`` fills the field ``for_``."""
    return {
        one.name.rstrip("_"): one.metadata["key"]
        for one in fields(declared)
        if "key" in one.metadata and one.metadata["table"] == table
    }
