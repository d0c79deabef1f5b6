"""How large an episode may be: compared before there is room for it, by every reader.

No recording of a robot comes near these bounds, and few bytes of a stranger's can claim more. One flag,
``--limits``, raises them, or the environment variable that it sets: worker processes inherit it.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, fields, replace
from functools import lru_cache

from safestage_eval.errors import InputError, TraceError

VARIABLE = "SAFESTAGE_LIMITS"
PER_STORED_BYTE = 64
"""Decoded bytes for each stored one that are allowed in any case: long recordings are large files."""

_UNITS = {"": 1, "k": 2**10, "m": 2**20, "g": 2**30, "t": 2**40}
_NONE = 1 << 62


@dataclass(frozen=True)
class Limits:
    """Bounds on one episode, unless something else is said.

    Attributes:
        bodies: of a header.
        geoms: of all bodies.
        joints: of a header.
        vertices: of a mesh.
        text: characters of a name, prompt, note or other single text.
        document: characters of a header, or of a file of JSON, TOML or XML.
        frames: of an episode.
        contacts: rows per frame.
        decoded: bytes that compressed data become, where that is more than 64 for each stored one.
        seconds: of processor time for reading and judging.
        memory: bytes that reading and judging may add to what the process holds.
    """

    bodies: int = 4_096
    geoms: int = 32_768
    joints: int = 1_024
    vertices: int = 2_000_000
    text: int = 65_536
    document: int = 16 << 20
    frames: int = 2_000_000
    contacts: int = 4_096
    decoded: int = 256 << 20
    seconds: int = 300
    memory: int = 8 << 30

    def demand(self, name: str, number: int, where: str) -> None:
        """Compare a number with the limit of that name, before memory for it is allocated.

        Raises TraceError with the flag that raises the limit.
        """
        most = getattr(self, name)
        if number > most:
            raise TraceError(
                where, f"{number:,} {name}{_PER.get(name, '')}.", f"{most:,} at most",
                f"if it is no mistake, raise the limit: --limits {name}={number}",
            )  # fmt: skip

    def allowed(self, stored: int) -> int:
        """Bytes that stored bytes may unpack to."""
        return max(self.decoded, PER_STORED_BYTE * stored)

    def demand_decoded(self, size: int, stored: int, where: str) -> None:
        """Compare the bytes that a file's data become with those that it has. Raises TraceError."""
        if size > self.allowed(stored):
            raise TraceError(
                where, f"{stored:,} stored bytes would become {size:,}.",
                f"{self.decoded:,} at most, or {PER_STORED_BYTE} for each stored one",
                f"if it is no mistake, raise the limit: --limits decoded={size}",
            )  # fmt: skip


_PER = {
    "contacts": " in one frame",
    "text": " characters in one text",
    "document": " characters of text",
}


def parse_limits(text: str) -> Limits:
    """``bodies=10000,decoded=1GB``, or ``none``. Raises InputError for anything else."""
    names = [field.name for field in fields(Limits)]
    if text.strip() == "none":
        return Limits(**dict.fromkeys(names, _NONE))
    found = {}
    for part in filter(None, map(str.strip, text.split(","))):
        name, equals, value = part.partition("=")
        if name.strip() not in names or not equals:
            raise InputError(
                f"--limits {part}", "is no limit.",
                f"none, or NAME=NUMBER with {', '.join(names)}",
            )  # fmt: skip
        try:
            found[name.strip()] = _NONE if value.strip() == "none" else size(value)
        except InputError as error:
            raise InputError(f"--limits {part}", error.what, error.allowed) from None
    return replace(Limits(), **found)


def current() -> Limits:
    """The limits of this process. Raises InputError where the environment's are none."""
    return _parsed(os.environ.get(VARIABLE, ""))


_parsed = lru_cache(4)(parse_limits)


def size(text: str) -> int:
    """Bytes, or a count, from ``600 MB``, ``2GiB`` or a plain number; kilo is 1,024. Raises InputError."""
    found = re.fullmatch(r"\s*(\d{1,18}(?:\.\d{1,9})?)\s*([kmgt]?)(?:i?b)?\s*", text, re.I | re.A)
    if not found:
        raise InputError(text, "is no amount of memory.", "such as 800 MB or 2 GB")
    return int(float(found[1]) * _UNITS[found[2].lower()])
