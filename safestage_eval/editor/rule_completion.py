"""Completions at a position of a rule file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from safestage_eval.evidence.declare import Signal
from safestage_eval.relations.vocabulary import GROUPS, RELATIONS
from safestage_eval.rules import string_parser
from safestage_eval.rules.clauses import CLAUSES
from safestage_eval.rules.files import benchmark_names, builtin_names
from safestage_eval.rules.names import a_dimension
from safestage_eval.rules.obligation_checks import WORDS
from safestage_eval.rules.table_keys import REPEATED, TABLES, TOP
from safestage_eval.signals import SIGNALS
from safestage_eval.units import DIMENSIONS, same_kind

from .known_names import KnownNames
from .rule_cursor import Place, place_at
from .rule_slots import Slot, slot_at


@dataclass(frozen=True)
class Offer:
    """One thing that may be written.

    Attributes:
        label: as listed, and what is written unless ``insert`` says otherwise.
        kind: ``signal``, ``relation``, ``state``, ``phase``, ``parameter``, ``column``, ``unit``, ``role``,
            ``tag``, ``key``, ``word`` or ``name``.
        detail: one short line: its dimension, its value.
        meaning: a sentence.
        insert: what is written instead of the label.
        arguments: of something that is called: the names to be filled in.
    """

    label: str
    kind: str
    detail: str = ""
    meaning: str = ""
    insert: str = ""
    arguments: tuple[str, ...] = ()


@dataclass(frozen=True)
class Completion:
    """Offers, and how many characters before the cursor they replace."""

    offers: tuple[Offer, ...]
    replaces: int = 0


_QUANTITY = re.compile(rf"(?:^|[\s(\[<>=-]){string_parser.NUMBER} ?([A-Za-z%][\w/^]*(?: [ms]?)?)?$")
_IN_CALL = re.compile(r"([a-z][a-z0-9_]*)\([^()]*$")
_WORD = re.compile(r"[A-Za-z_][\w-]*$")
_CONDITIONS = ("condition", "alternative", "alternatives")


def complete(text: str, offset: int, known: KnownNames) -> Completion:
    """Completions at a position; none where the language leaves the text to the author."""
    place = place_at(text, offset)
    if place.what == "nothing":
        return Completion(())
    if place.what == "table":
        return Completion(tuple(_headers(place.before, text, offset)), len(place.before))
    slot = slot_at(place.path)
    if slot is None:
        return Completion(())
    typed = _WORD.search(place.before)
    word = typed[0] if typed else ""
    rest = place.before[: len(place.before) - len(word)]
    called = _IN_CALL.search(rest)
    if place.what == "key" and not called:
        return Completion(tuple(_keys(slot, place, known)), len(place.before))
    if not called and (quantity := _QUANTITY.search(place.before)):
        unit = quantity[1] or ""
        if dimensions := _dimensions(slot, known):
            space = "" if place.before[: len(place.before) - len(unit)].endswith(" ") else " "
            units = [Offer(u, "unit", d, insert=space + u) for u, d in _units(dimensions)]
            return Completion(tuple(units), len(unit))
    if called:
        return Completion(tuple(_arguments(slot, called[1], known)), len(word))
    offers = _values(slot, rest, known, place)
    return Completion(tuple(offers if place.quoted else map(_in_quotes, offers)), len(word))


def _in_quotes(offer: Offer) -> Offer:
    """Return the text as it is written outside of a string."""
    if offer.label in ("true", "false"):
        return offer
    return replace(offer, insert=f'"{offer.insert or offer.label}"')


def _headers(before: str, text: str, offset: int) -> Iterator[Offer]:
    double = text[:offset].endswith("[[" + before)
    for name in TOP:
        if double == (name in REPEATED):
            yield Offer(name, "key", "table")
    if not double:
        kinds = [kind for kind in REPEATED if f"[[{kind}]]" in text[:offset]]
        for kind in kinds[-1:]:
            for key in (*CLAUSES, "roles", "examples", "severity", "set"):
                yield Offer(
                    f"{kind}.{key}", "key", f"of the {kind} above", TABLES["rule"][key].meaning
                )


def _keys(slot: Slot, place: Place, known: KnownNames) -> Iterator[Offer]:
    """Keys of a table, entries of a condition, names of parameters."""
    kind, _, table = slot.kind.partition(" ")
    if kind == "table" and table in TABLES:
        for name, key in TABLES[table].items():
            yield Offer(name, "key", "required" if key.required else "", key.meaning, f"{name} = ")
    elif kind in _CONDITIONS:
        for offer in _calls(slot, known):
            call = offer.insert or offer.label
            yield offer if place.quoted else replace(offer, insert=f'"{call}" = ')
        yield Offer(
            "any", "word", meaning="At least one of a list of alternatives.", insert="any = "
        )
    elif kind in ("settings", "table") and slot.kind != "table material":
        for offer in _params(known, None) if kind == "settings" else ():
            yield Offer(offer.label, "parameter", offer.detail, offer.meaning, f"{offer.label} = ")
    elif kind == "table":
        for column, dimension in known.names.columns.items():
            yield Offer(column, "column", dimension or "", insert=f"{column} = ")
    elif kind == "roles":
        for role in known.roles:
            if role not in GROUPS:
                yield Offer(role, "role", insert=f"{role} = ")
    elif kind == "levels":
        for level in ("minor", "serious", "critical"):
            yield Offer(level, "name", insert=f"{level} = ")


def _values(slot: Slot, before: str, known: KnownNames, place: Place) -> Iterator[Offer]:
    """Words of the value of a slot; ``before``: what stands in it before the word."""
    match slot.kind:
        case "entry":
            yield from _of_entry(slot, known)
        case "event" | "alternative" | "alternatives":
            yield from _words("start", "end", "success", "start of", "end of")
            yield from _calls(slot, known, signals=False)
        case "span":
            yield from _words("episode", "first", "last", "from", "while", "before", "after")
            for name, formals in known.names.phases.items():
                yield _called(name, formals or (), "phase", "phase", "")
            yield from _calls(slot, known, signals=False)
            yield from _params(known, "time")
        case "duration":
            yield from _params(known, "time")
        case "role":
            yield from _of_role(slot, before, known, place)
        case "call" | "operand":
            yield from _calls(slot, known, states=False)
        case "value":
            yield from _params(known, None)
        case "base":
            yield from (Offer(s.name, "signal", s.dimension, s.meaning) for s in SIGNALS.values())
        case "per":
            yield from _words("start", "second", "step")
        case "flag":
            yield from _words("true", "false")
        case "goal":
            yield from (Offer(name, "name", "goal") for name in sorted(known.names.goals))
        case "text" if slot.name == "family":
            yield from (Offer(name, "name", "family") for name in sorted(known.names.families))
        case "text" if slot.name == "explain" and before.endswith("{"):
            yield from _of_sentence(slot, known)
        case "texts":
            yield from _listed(slot, known)


def _listed(slot: Slot, known: KnownNames) -> Iterator[Offer]:
    if slot.name == "rules":
        yield from (Offer(code, "name", "rule") for code in sorted(known.names.rules))
    elif slot.name == "extends":
        for name in (*builtin_names(), *benchmark_names()):
            yield Offer(name, "name", "built-in rule file")
    elif slot.name == "tags":
        yield from (Offer(tag, "tag") for tag in known.tags)


def _of_entry(slot: Slot, known: KnownNames) -> Iterator[Offer]:
    """A limit of a signal, or the truth of a state."""
    dimension = _dimension_of(slot, known)
    if dimension is None:
        yield from _words("true", "false", "at least", "at most")
        yield from (Offer(role, "role") for role in known.roles_of(slot.owner))
        return
    yield from (
        Offer(op, "word", a_dimension(dimension), insert=f"{op} ") for op in (">=", "<=", ">", "<")
    )
    yield from _params(known, dimension)
    for column, of in known.names.columns.items():
        if of is not None and same_kind(of, dimension):
            roles = tuple(known.roles_of(slot.owner)[:1]) or ("a",)
            yield _called(column, roles, "column", of, "Value of the material of a body.")


def _of_role(slot: Slot, before: str, known: KnownNames, place: Place) -> Iterator[Offer]:
    if before.endswith("tagged "):
        yield from (Offer(tag, "tag") for tag in known.tags)
    elif re.search(r"except [\w, ]*$", before):
        others = dict.fromkeys((*place.keys, *known.roles_of(slot.owner)))
        yield from (Offer(role, "role") for role in others if role != slot.name)
    elif before:
        yield from (Offer(kind, "word", "kind of body") for kind in string_parser.ROLE_KINDS)
        yield from _words("named", "unnamed", "tagged", "except")
    else:
        yield from (Offer(kind, "word", "one body") for kind in string_parser.ROLE_KINDS)
        yield from (
            Offer(f"every {kind}", "word", "each body") for kind in string_parser.ROLE_KINDS
        )


def _of_sentence(slot: Slot, known: KnownNames) -> Iterator[Offer]:
    for role in known.roles_of(slot.owner):
        yield Offer(role, "role", insert=f"{role}}}")
    yield from (Offer(word, "word", insert=f"{word}}}") for word in WORDS)


def _arguments(slot: Slot, name: str, known: KnownNames) -> Iterator[Offer]:
    """Roles that may stand as arguments of a call."""
    signal, relation = known.names.signal(name), RELATIONS.get(name)
    groups = (signal is None and relation is None) or bool(
        (signal and signal.groups) or (relation and relation.groups)
    )
    yield from (Offer(role, "role") for role in known.roles_of(slot.owner))
    if groups and name not in known.names.columns:
        yield from (Offer(group, "role", meaning) for group, meaning in GROUPS.items())


def _calls(
    slot: Slot, known: KnownNames, *, signals: bool = True, states: bool = True
) -> Iterator[Offer]:
    """Everything that takes roles."""
    roles = known.roles_of(slot.owner)
    for signal in _signals(known) if signals else ():
        args = _fitting(signal.args[: signal.arities[0]], roles)
        yield _called(signal.name, args, "signal", signal.dimension, signal.meaning)
    if not states:
        return
    for relation in RELATIONS.values():
        args = _fitting(relation.args, roles)
        yield _called(relation.name, args, "relation", "true or false", relation.meaning)
    for name, formals in known.names.states.items():
        yield _called(name, _fitting(formals or (), roles), "state", "true or false", "")


def _signals(known: KnownNames) -> Iterator[Signal]:
    """Built-in signals that need no option, and the declared ones."""
    for signal in SIGNALS.values():
        if not any(option.required and option.name != signal.named for option in signal.options):
            yield signal
    for name, variant in known.names.variants.items():
        if variant is not None:
            yield replace(variant, name=name)


def _fitting(formals: Sequence[str], roles: Sequence[str]) -> tuple[str, ...]:
    """The roles of a rule in their order, where there are enough of them; else the formal names."""
    return tuple(roles[: len(formals)] if len(roles) >= len(formals) else formals)


def _called(name: str, args: Sequence[str], kind: str, detail: str, meaning: str) -> Offer:
    call = f"{name}({', '.join(args)})" if args or kind != "phase" else name
    return Offer(call, kind, detail, meaning, arguments=tuple(args))


def _params(known: KnownNames, dimension: str | None) -> Iterator[Offer]:
    for name, of in known.names.params.items():
        if of is None or (dimension is not None and not same_kind(of, dimension)):
            continue
        place = known.declared("param", name)
        value = place[0].table["param"][name] if place else ""
        yield Offer(name, "parameter", f"{value} ({of})")


def _words(*words: str) -> Iterator[Offer]:
    yield from (Offer(word, "word") for word in words)


def _dimension_of(slot: Slot, known: KnownNames) -> str | None:
    """Dimension of the signal of an entry; None of a state."""
    signal = known.names.signal(slot.name.partition("(")[0])
    return None if signal is None else signal.dimension


def _dimensions(slot: Slot, known: KnownNames) -> tuple[str, ...]:
    """Dimensions whose units may follow a number."""
    match slot.kind:
        case "entry":
            of = _dimension_of(slot, known)
            return () if of is None else (of,)
        case "duration" | "span":
            return ("time",)
        case "setting":
            own = slot.owner[0] in ("param", "material")
            of = known.names.columns.get(slot.name) or known.names.params.get(slot.name)
            return tuple(DIMENSIONS) if own or of is None else (of,)
        case "value" | "operand" | "text":
            return tuple(DIMENSIONS) if slot.kind != "text" or slot.owner[0] == "signal" else ()
    return ()


def _units(dimensions: Sequence[str]) -> Iterator[tuple[str, str]]:
    for dimension in dimensions:
        yield from ((unit, dimension) for unit in DIMENSIONS[dimension])
        if dimension == "time":
            yield "frames", dimension
