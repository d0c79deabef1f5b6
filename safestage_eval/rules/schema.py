"""JSON Schema of rule files, for editors: ``python -m safestage_eval.rules.schema [FOLDER]``.

It knows the grammar, the built-in names and their dimensions. What needs the other definitions
(names that the file or one it extends declares, roles, circles) only ``check`` can tell.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

from safestage_eval.evidence.declare import Option, Signal
from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.signals import SIGNALS
from safestage_eval.units import DIMENSIONS, UNIT_DIMENSION

from . import string_parser
from .clauses import CLAUSES
from .keys import Key
from .operations import OPERATIONS, OperationSpec
from .string_parser import NUMBER, pattern
from .table_keys import IN_BIND, NAMED, REPEATED, TABLES
from .tables import CODE, FORMAT, KINDS

FILE = "rules.schema.json"

_NAME = string_parser.NAME


def schema() -> dict[str, Any]:
    """The schema (draft 7, which editors' TOML plugins understand)."""
    tables = {kind: _table(kind) for kind in TABLES if kind not in IN_BIND}
    names = f"^{_NAME}$"
    top: dict[str, Any] = {
        "ruleset": tables["ruleset"],
        "baseline": tables["baseline"],
        "param": _mapping(names, _setting()),
        "material": _mapping(names, _mapping(names, _quantity())),
        **{kind: _mapping(names, tables[kind]) for kind in NAMED},
        **{kind: {"type": "array", "items": tables[kind]} for kind in REPEATED},
    }
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "SafeStage rule file",
        "type": "object",
        "properties": top,
        "required": ["ruleset"],
        "additionalProperties": False,
        "definitions": {
            "condition": _condition("inner_alternative"),
            "inner_condition": _condition(None),
            "alternative": _alternative("condition"),
            "inner_alternative": _alternative("inner_condition"),
        },
    }


def schema_text() -> str:
    """The schema as the file that is committed."""
    text = json.dumps(schema(), indent=2, ensure_ascii=False) + "\n"
    return text.replace("\\\\ ", " ")  # an escaped space is no pattern outside Python


def _table(kind: str) -> dict[str, Any]:
    spec = TABLES[kind]
    out: dict[str, Any] = {
        "type": "object",
        "properties": {
            name: _key(key) | {"description": key.meaning} for name, key in spec.items()
        },
        "additionalProperties": False,
    }
    required = [name for name, key in spec.items() if key.required]
    if required:
        out["required"] = required
    if kind == "rule":
        out["anyOf"] = [{"required": [key]} for key in CLAUSES]
    if kind in REPEATED:
        out["allOf"] = [
            {"not": {"required": pair}}
            for pair in [["at", "during"], ["at", "until"]]
            + ([[c.kind, "for"] for c in CLAUSES.values() if not c.lasts] if kind == "rule" else [])
        ]
    if kind == "signal":
        out["allOf"] = [_options(spec) for spec in SIGNALS.values()]
        out["oneOf"] = [{"required": [name]} for name in ("base", *OPERATIONS)]
        for name, operation in OPERATIONS.items():
            out["properties"][name] |= _operands(operation)
    if kind == "charge":
        out["oneOf"] = [{"required": ["when"]}, {"required": ["of"]}]
    return out


def _options(spec: Signal) -> dict[str, Any]:
    """With this base: these options, and no others."""
    then: dict[str, Any] = {"propertyNames": {"enum": ["base", *(o.name for o in spec.options)]}}
    required = [option.name for option in spec.options if option.required]
    if required:
        then["required"] = required
    if spec.options:
        then["properties"] = {option.name: _option(option) for option in spec.options}
    return {
        "if": {"properties": {"base": {"const": spec.name}}, "required": ["base"]},
        "then": then,
    }


def _option(option: Option) -> dict[str, Any]:
    match option.kind:
        case "time":
            units = "|".join(string_parser.TIME_UNITS)
            text = rf"{NUMBER} (?:{units})|\d+ frames? @ {NUMBER} Hz"
            return _text(f"{text}|{_NAME}" if option.param else text)
        case "length":
            return _text(f"{NUMBER} ?(?:{'|'.join(DIMENSIONS['length'])})")
        case "channel":
            return _text(_NAME)
        case "box":
            length = f"-?{NUMBER} ?(?:{'|'.join(DIMENSIONS['length'])})"
            corner = {**_list(_text(length)), "minItems": 3, "maxItems": 3}
            return {**_list(corner), "minItems": 2, "maxItems": 2}
    return {"enum": list(option.choices or (*UNIT_DIMENSION, "1"))}


def _key(key: Key) -> dict[str, Any]:
    """What a key may hold: by its grammar, as a kind of its own, or by its type in TOML."""
    kind, names = key.kind, f"^{_NAME}$"
    types, production = KINDS[kind].types, KINDS[kind].grammar
    if production:
        one = _text(pattern(production))
        return _mapping(names, one) if types is dict else one
    match kind:
        case "base":
            return {"enum": list(SIGNALS)}
        case "box":
            return {"type": "array"}
        case "format":
            return {"const": FORMAT}
        case "code":
            return _text(CODE)
        case "names":
            return {"type": "array", "items": _text(_NAME), "uniqueItems": True}
        case "condition" | "alternative":
            return {"$ref": f"#/definitions/{kind}"}
        case "alternatives":
            one = {"$ref": "#/definitions/alternative"}
            lone = {"allOf": [{"$ref": "#/definitions/condition"}, {"maxProperties": 1}]}
            return {"anyOf": [_text(pattern("EVENT")), lone, _list(one)]}
        case "settings":
            return _mapping(names, _setting())
        case "levels":
            return _mapping(names, _mapping(names, _setting()))
        case "examples":
            return _table("examples")
        case "charges":
            return _list(_table("charge"))
        case "operands":
            return {}  # as many as the operation takes
        case "value" | "budget":
            limit = _text(f"(?:{pattern('QUANTITY')}|{pattern('REFERENCE')})")
            return {"anyOf": [{"type": "number"}, limit]}
        case "per":
            return {"enum": ["start", "second", "step"]}
    return _OF_TYPE[types]


_OF_TYPE: dict[Any, dict[str, Any]] = {
    str: {"type": "string"}, bool: {"type": "boolean"}, (int, float): {"type": "number"},
    list: {"type": "array", "items": {"type": "string"}},
}  # fmt: skip
"""What TOML gives → what JSON Schema calls it."""


def _operands(operation: OperationSpec) -> dict[str, Any]:
    """A list of signals and constants, or just one signal; of ``holds`` a state."""
    if operation.of_state:
        return _text(pattern("CALL"))
    since = f"(?: since {pattern('EVENT')})?"
    one = _text(f"(?:{pattern('CALL')}{since}|{pattern('QUANTITY')}|-?{_NAME})")
    several = _list({"anyOf": [{"type": "number"}, one]})
    several |= {"minItems": operation.least, "maxItems": operation.most}
    return {"anyOf": [one, several]} if operation.least == 1 else several


def _condition(nested: str | None) -> dict[str, Any]:
    """A table of entries; ``nested`` is what ``any`` may list, None where it may not stand."""
    entries: dict[str, Any] = {}
    for spec in SIGNALS.values():
        limit = _text(_limit_of(spec))
        since = f"(?: since {pattern('EVENT')})?" if spec.since else ""
        if any(option.required and option.name != spec.named for option in spec.options):
            continue  # only variants of it can be used
        for arity in spec.arities:
            entries[f"^{_call(spec.name, arity)}{since}$"] = {
                "anyOf": [limit, _list(limit)],
                "description": f"{spec.dimension}: {spec.meaning}",
            }
    for relation in RELATIONS.values():
        entries[f"^{_call(relation.name, len(relation.args))}$"] = {
            "anyOf": [{"type": "boolean"}, _text(pattern("COUNT"))],
            "description": relation.meaning,
        }
    built_in = "|".join([*SIGNALS, *RELATIONS])
    entries[rf"^(?!(?:{built_in})\(){pattern('CALL')}(?: since {pattern('EVENT')})?$"] = {
        "anyOf": [
            {"type": "boolean"},
            _text(pattern("COUNT")),
            _text(pattern("LIMIT")),
            _list(_text(pattern("LIMIT"))),
        ]
    }
    properties = {} if nested is None else {"any": _list({"$ref": f"#/definitions/{nested}"})}
    return {
        "type": "object",
        "properties": properties,
        "patternProperties": entries,
        "additionalProperties": False,
        "minProperties": 1,
    }


def _alternative(condition: str) -> dict[str, Any]:
    return {"anyOf": [_text(pattern("EVENT")), {"$ref": f"#/definitions/{condition}"}]}


def _limit_of(spec: Signal) -> str:
    units = "|".join(
        re.escape(u) for u in sorted(DIMENSIONS[spec.dimension], key=len, reverse=True)
    )
    unit = f" ?(?:{units})"
    if spec.dimension == "ratio":
        unit = f"(?:{unit})?"
    if spec.dimension == "number":
        unit = ""
    return f"(?:>=|<=|>|<) ?(?:-?{NUMBER}{unit}|{pattern('REFERENCE')})"


def _call(name: str, arity: int) -> str:
    return rf"{name}\({', *'.join([_NAME] * arity)}\)"


def _setting() -> dict[str, Any]:
    frames = rf"{NUMBER} frames?(?: @ {NUMBER} Hz)?"
    return {"anyOf": [{"type": "number"}, _text(f"(?:{pattern('QUANTITY')}|{frames})")]}


def _quantity() -> dict[str, Any]:
    return {"anyOf": [{"type": "number"}, _text(pattern("QUANTITY"))]}


def _text(pattern: str) -> dict[str, Any]:
    return {"type": "string", "pattern": f"^(?:{pattern})$"}


def _list(item: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": item, "minItems": 1}


def _mapping(names: str, value: dict[str, Any]) -> dict[str, Any]:
    return {"type": "object", "patternProperties": {names: value}, "additionalProperties": False}


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "schemas")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / FILE).write_text(schema_text(), "utf-8")
