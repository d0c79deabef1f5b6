"""The options of a ``[signal.NAME]``: TOML values in, SI values out."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from safestage_eval.evidence.declare import Option, OptionValue
from safestage_eval.signals import SIGNALS
from safestage_eval.units import UNIT_DIMENSION

from . import string_parser
from . import syntax as ast


def read_option(spec: Option, value: Any) -> OptionValue | ast.Parameter:
    """The value of one option in SI. Raises GrammarError."""
    match spec.kind:
        case "time":
            return _time(spec, value)
        case "length":
            return _length(spec, value)
        case "box":
            return _box(spec, value)
        case "channel":
            if isinstance(value, str) and re.fullmatch(string_parser.NAME, value):
                return value
            raise string_parser.GrammarError(
                f"{value!r} cannot be the name of a channel",
                "a small letter, then small letters, digits and underscores",
            )
    choices = spec.choices or (*UNIT_DIMENSION, "1")
    if isinstance(value, str) and value in choices:
        return value
    raise string_parser.GrammarError(f'"{spec.name}" cannot be {value!r}', ", ".join(choices))


def read_options(table: Mapping[str, Any]) -> ast.SignalOptions:
    """All options of a checked ``[signal.NAME]``, sorted by name; left out, they are as usual."""
    options: dict[str, OptionValue | ast.Parameter] = {}
    for option in SIGNALS[table["base"]].options:
        if option.name in table:
            options[option.name] = read_option(option, table[option.name])
        elif option.default is not None and not option.param:
            options[option.name] = option.default
    return tuple(sorted(options.items(), key=lambda item: item[0]))


def _time(spec: Option, value: Any) -> float | ast.Parameter:
    lasting = string_parser.duration(value) if isinstance(value, str) else None
    if spec.param and isinstance(lasting, ast.Parameter):
        return lasting
    if isinstance(lasting, ast.Duration) and not lasting.frames and lasting.amount > 0:
        return lasting.amount
    raise string_parser.GrammarError(
        f'"{spec.name}" is a time that does not hang on the rate of the trace, not {value!r}',
        '"50 ms", "3 frames @ 120 Hz"',
    )


def _length(spec: Option, value: Any) -> float:
    length = string_parser.quantity(value) if isinstance(value, str) else None
    if length is not None and length.dimension == "length" and length.value >= 0:
        return length.value
    raise string_parser.GrammarError(f'"{spec.name}" is a length, not {value!r}', '"2 cm", "5 mm"')


def _box(spec: Option, value: Any) -> tuple[float, ...]:
    corners = value if isinstance(value, list | tuple) else ()
    if len(corners) != 2 or not all(isinstance(c, list | tuple) and len(c) == 3 for c in corners):
        raise string_parser.GrammarError(
            f'"{spec.name}" is two corners of three lengths', '[["-50 cm", "-1 m", "0 m"], [...]]'
        )
    lengths = [string_parser.quantity(x) for corner in corners for x in corner]
    for length in lengths:
        if length.dimension != "length":
            raise string_parser.GrammarError(f"{length.text!r} is not a length", '"50 cm", "-1 m"')
    low, high = lengths[:3], lengths[3:]
    for axis, a, b in zip("xyz", low, high, strict=True):
        if not a.value < b.value:
            raise string_parser.GrammarError(
                f"the box is empty along {axis}: from {a.text} to {b.text}",
                "the lower corner first",
            )
    return tuple(length.value for length in lengths)
