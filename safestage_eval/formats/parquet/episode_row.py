"""The header of an episode as one row of ``meta/episodes`` plus its rows in ``geometry``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import isfinite
from types import MappingProxyType
from typing import Any

from safestage_eval._text.json_text import from_json
from safestage_eval.episode import Header
from safestage_eval.errors import TraceError
from safestage_eval.formats.header_limits import check_counts, check_texts, validated
from safestage_eval.units import FINITE

from .arrow_tables import EPISODES

_JSON_FIELDS = tuple(
    name for name in Header.model_fields if EPISODES[name].unit == "JSON" and name != "bodies"
)
_FLAT_FIELDS = tuple(name for name in Header.model_fields if EPISODES[name].unit != "JSON")


def encode(value: Any, where: str) -> str:
    """Return compact JSON. Raises TraceError for NaN and infinity, which JSON does not have."""
    try:
        return json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    except ValueError:
        raise TraceError(
            where, "the header holds a number that is not finite.", "finite numbers, or none at all"
        ) from None


def to_row(header: Header) -> dict[str, Any]:
    """Return the header's columns in ``meta/episodes``. Raises TraceError as ``encode`` does."""
    where = header.episode_id
    data = header.model_dump(mode="json")
    encode({name: data[name] for name in _FLAT_FIELDS}, where)
    row = {name: data[name] for name in _FLAT_FIELDS}
    row |= {name: encode(data[name], where) for name in _JSON_FIELDS}
    encode([geom for body in data["bodies"] for geom in body.pop("geoms")], where)
    return row | {"bodies": encode(data["bodies"], where)}


def to_geometry(header: Header, episode_index: int) -> list[dict[str, Any]]:
    """Return the rows of ``geometry``, one per geom in the header's order."""
    geoms = [(body.name, geom) for body in header.bodies for geom in body.geoms]
    return [
        {"episode_index": episode_index, "body": body, "geom": i} | geom.model_dump()
        for i, (body, geom) in enumerate(geoms)
    ]


def from_row(
    row: Mapping[str, Any],
    geometry: list[dict[str, Any]],
    where: str,
    known: Mapping[str, Any] = MappingProxyType({}),
) -> Header:
    """Restore a header. Columns that are absent or null take the header's defaults.

    Args:
        row: of ``meta/episodes``.
        geometry: rows of ``geometry``.
        where: place that messages name.
        known: fields of the header that were understood before: the bodies with their geoms, …

    Raises:
        TraceError: text that is not JSON, a geom of an unknown body, or values a header refuses.
    """
    check_texts(row, where)
    data = {name: row[name] for name in _FLAT_FIELDS if row.get(name) is not None}
    for name in (*_JSON_FIELDS, "bodies"):
        if row.get(name) is None or name in known:
            continue
        try:
            data[name] = from_json(row[name])
        except ValueError as error:
            raise TraceError(f"{where}, column {name}", f"not JSON: {error}") from None
    for place, values in (("header field", data), *(("geometry,", geom) for geom in geometry)):
        _demand_finite(values, f"{where}, {place}")
    if "bodies" not in known:
        _add_geoms(data, geometry, where)
    header = validated(Header, {**data, **known}, f"{where}, header field")
    check_counts(header, where)
    return header


def _demand_finite(values: Mapping[str, Any], place: str) -> None:
    """Raises TraceError for a column of numbers that are not finite: JSON, read before, has none."""
    for name, value in values.items():
        some = value if isinstance(value, list | tuple) else (value,)
        if any(isinstance(number, float) and not isfinite(number) for number in some):
            raise TraceError(
                f"{place} {name}", "a number that is not finite.", FINITE,
                "record the episode again, or leave the field out",
            )  # fmt: skip


def _add_geoms(data: dict[str, Any], geometry: list[dict[str, Any]], where: str) -> None:
    """Add geoms to the bodies of a header that they belong to."""
    listed = data.get("bodies", [])
    if not isinstance(listed, list) or not all(isinstance(body, dict) for body in listed):
        raise TraceError(f"{where}, column bodies", "not a list of bodies.", "JSON records")
    bodies = {str(body.get("name")): body for body in listed}
    for geom in geometry:
        if not (isinstance(geom["geom"], int) and isinstance(geom["body"], str)):
            problem = f"geometry has a row of body {geom['body']!r}, geom {geom['geom']!r}."
            raise TraceError(where, problem, "a name and a number")
    for geom in sorted(geometry, key=lambda geom: geom["geom"]):
        if geom["body"] not in bodies:
            raise TraceError(
                where,
                f"geometry names {geom['body']!r}, which is no body.",
                ", ".join(map(str, bodies)),
            )
        own = {name: value for name, value in geom.items() if value is not None}
        bodies[geom["body"]].setdefault("geoms", []).append(own)


def mesh_keys(header: Header) -> list[str]:
    """Return the keys of the meshes that the header's geoms have, each once, in order."""
    geoms = (geom for body in header.bodies for geom in body.geoms)
    return list(dict.fromkeys(geom.mesh for geom in geoms if geom.mesh is not None))
