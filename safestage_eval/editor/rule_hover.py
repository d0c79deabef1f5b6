"""Hover pages: the meaning of a word of a rule file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from safestage_eval._text.line_width import LINE_WIDTH
from safestage_eval.relations.vocabulary import GROUPS, RELATIONS
from safestage_eval.report.rule_report import explain_vocabulary, vocabulary
from safestage_eval.rules.files import RuleFile
from safestage_eval.rules.locate import Keys
from safestage_eval.rules.names import a_dimension, table_of
from safestage_eval.rules.table_keys import TABLES
from safestage_eval.signals import SIGNALS
from safestage_eval.units import DIMENSIONS, UNIT_DIMENSION, ZERO

from .known_names import KnownNames
from .rule_cursor import place_at, words_around
from .rule_slots import slot_at

DECLARED = {
    "param": "parameter", "state": "state", "phase": "phase", "signal": "signal", "goal": "goal",
    "family": "family", "rule": "rule", "cost": "cost",
}  # fmt: skip
"""Table → what its entries are called."""


@dataclass(frozen=True)
class Page:
    """Describe a word.

    Attributes:
        markdown: the page.
        start, stop: the word's place in the text.
    """

    markdown: str
    start: int
    stop: int


def page_at(text: str, offset: int, known: KnownNames) -> Page | None:
    """The page of the word at a position; None if nothing is known of it."""
    place = place_at(text, offset)
    if place.what == "nothing":
        return None
    slot = slot_at(place.path)
    if place.what == "key" and slot and slot.kind.startswith("table ") and not place.quoted:
        for start, stop in words_around(text, offset):
            key = TABLES.get(slot.kind.removeprefix("table "), {}).get(text[start:stop])
            if key is not None:
                said = " It is required." if key.required else ""
                return Page(f"`{text[start:stop]}`: {key.meaning}{said}", start, stop)
    owner = slot.owner if slot else ()
    for start, stop in words_around(text, offset):
        called = text[stop : stop + 1] == "("
        for page in _pages(text[start:stop], owner, known, called=called):
            return Page(page, start, stop)
    return None


def _pages(word: str, owner: Keys, known: KnownNames, *, called: bool) -> Iterator[str]:
    """Pages of everything that has this name, what is nearest first."""
    if word in UNIT_DIMENSION:
        yield _of_unit(word)
    if word in known.roles_of(owner) and not called:
        yield _of_role(word, owner, known)
    if word in SIGNALS or word in RELATIONS:
        yield built_in_page(word)
    if called and word in known.names.columns:
        yield _of_column(word, known)
    for kind, said in DECLARED.items():
        if place := known.declared(kind, word):
            yield _of_declared(word, said, *place, known)
    if word in known.names.columns:
        yield _of_column(word, known)
    if word in GROUPS and not called:
        yield f"`{word}`: {GROUPS[word]}"


def built_in_page(name: str) -> str:
    """The page of a built-in signal or relation, as ``safestage rules signals NAME`` prints it."""
    entry = next(one for one in vocabulary() if one["name"] == name)
    token = LINE_WIDTH.set(None)
    try:
        calls, meaning, *facts = explain_vocabulary([entry]).rstrip().split("\n")
    finally:
        LINE_WIDTH.reset(token)
    rows = "\n".join(line.removeprefix("  ") for line in facts)
    return f"`{calls}`\n\n{meaning.strip()}\n\n```text\n{rows}\n```"


def _of_unit(unit: str) -> str:
    dimension = UNIT_DIMENSION[unit]
    factor = DIMENSIONS[dimension][unit]
    si = next(iter(DIMENSIONS[dimension]))
    shift = f" {ZERO[unit]:+g}" if unit in ZERO else ""
    said = f"; 1 {unit} = {1 * factor:g}{shift} {si}" if unit != si else ""
    return f"`{unit}`: {a_dimension(dimension)}{said}"


def _of_role(name: str, owner: Keys, known: KnownNames) -> str:
    file = known.files[-1]
    entry: Any = file.table
    for key in owner:
        entry = entry[key]
    roles = entry.get("roles")
    kind = owner[0]
    if isinstance(roles, dict) and name in roles:
        return f"`{name}`: role of this {kind}, {roles[name]}"
    return f"`{name}`: formal argument of {kind} {owner[-1]}"


def _of_column(name: str, known: KnownNames) -> str:
    rows = []
    materials: dict[str, Any] = {}
    for file in known.files:
        for material, row in table_of(file.table, "material").items():
            if isinstance(row, dict) and name in row:
                materials[material] = row[name]
    rows = [f"{material}: {value}" for material, value in materials.items()]
    listed = "\n".join(rows)
    return f"`{name}(role)`: value of the role's material\n\n```text\n{listed}\n```"


def _of_declared(name: str, said: str, file: RuleFile, keys: Keys, known: KnownNames) -> str:
    """The lines that declare a name, and where they stand."""
    spot = file.locations.key(keys)
    lines = file.text.splitlines()[spot.line - 1 :]
    stop = 1
    if said != "parameter":
        while (
            stop < len(lines) and not re.match(r"\s*\[{1,2}\w", lines[stop]) and stop < MOST_LINES
        ):
            stop += 1
    else:  # a comment goes on in indented lines that hold nothing else
        while stop < len(lines) and re.match(r"\s+#", lines[stop]):
            stop += 1
    shown = [*lines[:stop]]
    while shown and (not shown[-1].strip() or shown[-1].startswith("#")):
        shown.pop()
    signal = known.names.variants.get(name) if said == "signal" else None
    dimension = known.names.params.get(name) if said == "parameter" else signal and signal.dimension
    is_a = f", {a_dimension(dimension)}" if dimension else ""
    text = "\n".join(shown)
    return f"`{name}`: {said}{is_a}\n\n```toml\n{text}\n```\n\n{file.path}:{spot.line}"


MOST_LINES = 25
"""Lines of a definition that a page shows."""
