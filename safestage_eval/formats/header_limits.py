"""Headers of strangers: compared with the limits before they are understood, and understood."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from safestage_eval.episode import Header
from safestage_eval.errors import TraceError, shortened
from safestage_eval.size_limits import current

Model = TypeVar("Model", bound=BaseModel)

SHORT = 1 << 18
"""Characters of a text whose lists are counted only once they are understood: 20,000 bodies at most."""


def check_texts(texts: Mapping[str, Any], where: str) -> None:
    """Compare the texts of a header, JSON among them, with the limits. Raises TraceError.

    A long one is looked into: how many bodies and joints it lists, and how long its single texts are.
    """
    limits = current()
    for name, text in texts.items():
        demand_text(text, f"{where}, {name}")
        if not isinstance(text, str | bytes) or len(text) <= min(limits.text, SHORT):
            continue
        place = f"{where}, {name}"
        limits.demand("document", len(text), place)
        try:
            data = json.loads(text)
        except (ValueError, RecursionError):
            limits.demand("text", len(text), place)
            continue  # understanding it will say what is wrong
        check_data({name: data}, where)


def demand_text(text: Any, where: str) -> None:
    """Raises TraceError for a text that is no whole Unicode: others could neither store nor print it."""
    if isinstance(text, str) and not text.isascii():
        try:
            text.encode()
        except UnicodeEncodeError:
            raise TraceError(
                where, f'"{shortened(text, 80)}" is no text in UTF-8.', "whole characters of Unicode",
                "write the name anew, or leave the episode out",
            ) from None  # fmt: skip


def check_data(data: Any, where: str) -> None:
    """Compare lists and texts of a header that is plain data yet. Raises TraceError."""
    limits = current()
    waiting = [("", data)]
    while waiting:
        name, value = waiting.pop()
        if isinstance(value, str):
            limits.demand("text", len(value), f"{where}, {name}")
        elif isinstance(value, dict):
            for key, inside in value.items():
                limits.demand("text", len(str(key)), where)
                waiting.append((str(key)[:60], inside))
        elif isinstance(value, list):
            if name in ("bodies", "joints", "geoms"):
                limits.demand(name, len(value), where)
            waiting += ((name, inside) for inside in value)


def check_counts(header: Header, where: str) -> None:
    """Compare what a header lists with the limits. Raises TraceError."""
    limits = current()
    limits.demand("bodies", len(header.bodies), where)
    limits.demand("joints", len(header.joints), where)
    limits.demand("geoms", sum(len(body.geoms) for body in header.bodies), where)


def validated(model: type[Model], data: Any, place: str) -> Model:
    """Validate plain data as a record. Raises TraceError naming the first field that does not fit."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"])
        more = f" ({error.error_count()} problems in all)" if error.error_count() > 1 else ""
        raise TraceError(
            f"{place} {field}".rstrip(),
            f"{first['msg'].removeprefix('Value error, ')}{more}.",
            fix="see docs/traces.md",
        ) from None


def as_stored(header: Header) -> Header:
    """The header as a file gives it back: 1 where a float stands is 1.0, and a NumPy number a plain one.

    The same object where nothing changes. Raises TraceError for values that a header refuses.
    """
    place = f"{header.episode_id}, header field"
    stored = validated(Header, header.model_dump(warnings=False), place)
    return header if repr(stored) == repr(header) else stored
