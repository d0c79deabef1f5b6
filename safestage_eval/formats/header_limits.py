"""Headers compared with the limits: their texts before they are understood, their lists before bodies are made."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from safestage_eval.episode import Header
from safestage_eval.size_limits import current

SHORT = 1 << 18
"""Characters of a text whose lists are counted only once they are understood: 20,000 bodies at most."""


def check_texts(texts: Mapping[str, Any], where: str) -> None:
    """Compare the texts of a header, JSON among them, with the limits. Raises TraceError.

    A long one is looked into: how many bodies and joints it lists, and how long its single texts are.
    """
    limits = current()
    for name, text in texts.items():
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
