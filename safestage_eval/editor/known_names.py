"""The names that may be used in one rule file: its own, those it extends, and the roles around a cursor."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from safestage_eval.relations.vocabulary import GROUPS
from safestage_eval.rules.files import RuleFile, builtin_folder, read_edited, read_files
from safestage_eval.rules.locate import Keys
from safestage_eval.rules.names import Names

from .rule_cursor import readable

_TAGGED = re.compile(r"\btagged ([a-z][a-z0-9_]*)")


@dataclass(frozen=True)
class KnownNames:
    """Names from the files that were read together.

    Attributes:
        names: what is declared, with dimensions and formal arguments.
        files: the files, those that are extended first.
        tags: tags that roles of built-in rules and of these files name.
        roles: names of roles that built-in rules and these files use.
    """

    names: Names
    files: tuple[RuleFile, ...]
    tags: tuple[str, ...]
    roles: tuple[str, ...]

    def roles_of(self, owner: Keys) -> list[str]:
        """The roles or formal arguments of a rule, state, phase, signal or goal."""
        table = _at(self.files[-1].table, owner) if self.files else {}
        formals = table.get("of") if owner and owner[0] in ("state", "phase", "signal") else None
        own = formals if isinstance(formals, list) else table.get("roles", {})
        return [name for name in own if isinstance(name, str)]

    def declared(self, kind: str, name: str) -> tuple[RuleFile, Keys] | None:
        """The file that declares a name, the last that does, and the way to it."""
        for file in reversed(self.files):
            entries = file.table.get(kind)
            if kind in ("rule", "cost") and isinstance(entries, list):
                for index, entry in enumerate(entries):
                    if isinstance(entry, dict) and entry.get("code") == name:
                        return file, (kind, index)
            elif isinstance(entries, dict) and name in entries:
                return file, (kind, name)
        return None


def names_known(path: Path, text: str, texts: Mapping[Path, str]) -> KnownNames:
    """The names of a file as it is being typed, and of those it extends.

    Args:
        path: absolute; the file need not be there.
        text: what it says; lines that are no TOML are left out.
        texts: those of other open files.
    """
    files = read_edited(path, {**texts, path: readable(text) or ""})[0]
    tables = [file.table for file in files]
    names = Names.of_table(tables)
    tags, roles = _used_in(_builtin_tables() + tables)
    return KnownNames(names, tuple(files), tags, (*roles, *GROUPS))


def _used_in(tables: Sequence[Mapping[str, Any]]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The tags and the roles that rules name."""
    roles: dict[str, None] = {}
    tags: dict[str, None] = {}
    for table in tables:
        for kind in ("rule", "cost"):
            entries = table.get(kind)
            for entry in entries if isinstance(entries, list) else ():
                declared = entry.get("roles") if isinstance(entry, dict) else None
                for role, said in declared.items() if isinstance(declared, dict) else ():
                    roles[role] = None
                    tags |= dict.fromkeys(_TAGGED.findall(str(said)))
    return tuple(sorted({*tags, *USUAL_TAGS})), tuple(roles)


USUAL_TAGS = ("chemical", "electronics", "fragile", "heavy", "hot", "liquid", "sharp")
"""Tags that importers give, and that the format's documentation names; others are free."""


@lru_cache(1)
def _builtin_tables() -> list[dict[str, Any]]:
    return [file.table for file in read_files([builtin_folder()])[0]]


def _at(table: Mapping[str, Any], keys: Keys) -> Mapping[str, Any]:
    entry: Any = table
    for key in keys:
        try:
            entry = entry[key]
        except (KeyError, IndexError, TypeError):
            return {}
    return entry if isinstance(entry, dict) else {}
