"""What a file is that was taken for a table: recordings, rules, pictures, pages, texts for people."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

from safestage_eval.errors import InputError
from safestage_eval.formats.discover import MCAP_MAGIC
from safestage_eval.formats.parquet import dataset_layout as layout

_BEGINNINGS = {
    MCAP_MAGIC: "a recording (MCAP)",
    b"PK\x03\x04": "a ZIP file, as of safestage-record",
    b"\x89HDF": "an HDF5 file",
    b"\x89PNG": "a picture",
    b"\xff\xd8\xff": "a picture",
    b"GIF8": "a picture",
    b"RIFF": "a picture, film or sound",
    b"%PDF": "a PDF document",
    b"\x1f\x8b": "compressed",
    b"\x28\xb5\x2f\xfd": "compressed",
    b"<svg": "a picture",
    b"<!doctype": "a web page",
    b"<": "XML, as of --format junit",
}
_TOML = re.compile(rb"(?:\s*(?:#[^\n]*)?\n)*(?:\s*\[\[?[\w.]+\]\]?\s*(?:#[^\n]*)?\n|format *= *1)")
_SCORE = "safestage score TRACES --format parquet --output rows.parquet writes results"


def refuse_other_files(path: Path, beginning: bytes, allowed: str) -> None:
    """Raise InputError, which says what it is, for a file that is no table by its first bytes or its place."""
    text = beginning.removeprefix(b"\xef\xbb\xbf").lstrip()
    kind = next(
        (
            kind
            for magic, kind in _BEGINNINGS.items()
            if beginning.startswith(magic) or text[:9].lower().startswith(magic)
        ),
        "",
    )
    if not beginning:
        kind = "an empty file"
    elif _TOML.match(beginning):
        kind = "a TOML file: rules or bindings"
    elif not kind and b"\0" in beginning and not beginning.startswith(b"PAR1"):
        kind = "not a table: it holds no text"
    elif path.parent.name in (*layout.TABLE_FOLDERS, "episodes") and any(
        layout.is_dataset(folder) for folder in path.absolute().parents[1:3]
    ):
        kind = "a table of recordings, not of results"
    if kind:
        raise wrong_file(path, kind, allowed)


def refuse_other_columns(
    path: Path, names: Collection[str], wanted: Collection[str] | None, allowed: str
) -> None:
    """Raise InputError for a table, or a text, whose columns are none of those that are wanted."""
    if wanted is not None and not set(names) & set(wanted):
        first = ", ".join(names)[:60]
        raise wrong_file(path, f"text, or a table of something else: {first!r}", allowed)


def wrong_file(path: Path, kind: str, allowed: str) -> InputError:
    """The error that a file is something else, and how to make the right one."""
    return InputError(str(path), f"is {kind}.", allowed, _SCORE if "score" in allowed else "")
