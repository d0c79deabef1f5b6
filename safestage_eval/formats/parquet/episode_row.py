"""The row of an episode in ``meta/episodes``, and its header, of which ``geometry`` has the shapes."""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterable, Mapping
from math import isfinite
from pathlib import Path
from typing import Any

from safestage_eval._text.json_text import from_json
from safestage_eval.episode import Header
from safestage_eval.errors import TraceError
from safestage_eval.formats.header_limits import check_counts, check_texts, validated
from safestage_eval.formats.trace_files import check_link
from safestage_eval.units import FINITE

from .arrow_columns import records
from .arrow_tables import EPISODES, REQUIRED
from .table_file import TableFile

TABLE = "meta/episodes"

_JSON_FIELDS = tuple(name for name in Header.model_fields if EPISODES[name].unit == "JSON")
_FLAT_FIELDS = tuple(name for name in Header.model_fields if EPISODES[name].unit != "JSON")

_LAST: list[tuple[Hashable, dict[int, list[dict[str, Any]]]]] = []
"""The file that was read last, and its rows by episode.

Episodes of a file are mostly opened one after the other, and it may tell of hundreds of them.
"""


def read_rows(file: Path, columns: Iterable[str] = tuple(EPISODES)) -> list[dict[str, Any]]:
    """Read the rows of one file of ``meta/episodes``; columns that it lacks are left out.

    Raises:
        TraceError: unreadable, or without a required column.
    """
    check_link(file, file.parents[2], str(file))
    return _rows(TableFile(file, TABLE), columns)


def read_row(file: Path, episode_index: int) -> dict[str, Any]:
    """Read the row of one episode. Raises TraceError as ``read_rows``, and where there is not just one."""
    check_link(file, file.parents[2], str(file))
    table = TableFile(file, TABLE)
    if not _LAST or _LAST[0][0] != table.key:
        by_episode: dict[int, list[dict[str, Any]]] = {}
        for row in _rows(table, EPISODES):
            by_episode.setdefault(row["episode_index"], []).append(row)
        _LAST[:] = [(table.key, by_episode)]
    rows = _LAST[0][1].get(episode_index, [])
    if len(rows) != 1:
        raise TraceError(str(file), f"{len(rows)} rows with episode_index {episode_index}", "one")
    return rows[0]


def _rows(table: TableFile, columns: Iterable[str]) -> list[dict[str, Any]]:
    there, where = table.described, str(table.path)
    if lacking := [name for name in REQUIRED if name not in there]:
        allowed = ", ".join(EPISODES)
        raise TraceError(where, f"the column {lacking[0]!r} is missing.", allowed)
    stored = table.read([name for name in columns if name in there])
    for name in set(REQUIRED).intersection(stored.column_names):
        if stored[name].null_count:
            raise TraceError(where, f"{name} is empty in {stored[name].null_count} rows")
    return records(stored, TABLE, where)


def encode(value: Any, where: str) -> str:
    """Return compact JSON. Raises TraceError for NaN and infinity, which JSON does not have."""
    try:
        return json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    except ValueError:
        raise TraceError(
            where, "the header holds a number that is not finite.", "finite numbers, or none at all"
        ) from None


def to_rows(header: Header, episode_index: int) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the header's columns in ``meta/episodes`` and its rows in ``geometry``. Raises TraceError as ``encode``."""
    data = header.model_dump(mode="json")
    encode(data, header.episode_id)
    shapes = [
        {"episode_index": episode_index, "body": body["name"]} | geom
        for body in data["bodies"]
        for geom in body.pop("geoms")
    ]
    geometry = [{"geom": i} | shape for i, shape in enumerate(shapes)]
    row = {name: data[name] for name in _FLAT_FIELDS}
    return row | {name: encode(data[name], header.episode_id) for name in _JSON_FIELDS}, geometry


def to_header(
    row: Mapping[str, Any],
    geometry: list[dict[str, Any]],
    where: str,
    known: Mapping[str, Any],
) -> Header:
    """Restore a header. Columns that are absent or null take the header's defaults.

    Args:
        row: of ``meta/episodes``.
        geometry: rows of ``geometry``; none are needed of bodies that are known.
        where: place that messages name.
        known: fields of the header that were understood before: the bodies with their geoms, …

    Raises:
        TraceError: text that is not JSON, a geom of an unknown body, or values a header refuses.
    """
    check_texts(row, where)
    data = {name: row[name] for name in _FLAT_FIELDS if row.get(name) is not None}
    _demand_finite(data, f"{where}, header field")
    for name in _JSON_FIELDS:
        if row.get(name) is None or name in known:
            continue
        try:
            data[name] = from_json(row[name])
        except ValueError as error:
            raise TraceError(f"{where}, column {name}", f"not JSON: {error}") from None
    if "bodies" not in known:
        _add_geoms(data.get("bodies", []), geometry, where)
    header = validated(Header, {**data, **known}, f"{where}, header field")
    check_counts(header, where)
    return header


def _demand_finite(values: Mapping[str, Any], place: str) -> None:
    """Raises TraceError for a column of numbers that are not finite: JSON has none."""
    for name, value in values.items():
        some = value if isinstance(value, list) else (value,)
        if any(isinstance(number, float) and not isfinite(number) for number in some):
            raise TraceError(
                f"{place} {name}", "a number that is not finite.", FINITE,
                "record the episode again, or leave the field out",
            )  # fmt: skip


def _add_geoms(listed: Any, geometry: list[dict[str, Any]], where: str) -> None:
    """Add geoms to the records of the bodies that they belong to."""
    if not isinstance(listed, list) or not all(isinstance(body, dict) for body in listed):
        raise TraceError(f"{where}, column bodies", "not a list of bodies.", "JSON records")
    bodies = {str(body.get("name")): body for body in listed}
    for geom in geometry:
        _demand_finite(geom, f"{where}, geometry,")
        if geom.get("geom") is None or geom.get("body") is None:
            raise TraceError(where, "geometry has a row without body or geom.", "a name, a number")
        if geom["body"] not in bodies:
            problem = f"geometry names {geom['body']!r}, which is no body."
            raise TraceError(where, problem, ", ".join(map(str, bodies)))
    for geom in sorted(geometry, key=lambda geom: geom["geom"]):
        own = {name: value for name, value in geom.items() if value is not None}
        bodies[geom["body"]].setdefault("geoms", []).append(own)
