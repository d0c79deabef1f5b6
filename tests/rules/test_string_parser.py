"""Each production of the grammar: what it means, that it reads back, and what it refuses."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.rules import string_parser
from safestage_eval.rules.schema import schema
from safestage_eval.rules.syntax import (
    Around,
    Call,
    Column,
    Duration,
    Event,
    FromTo,
    Limit,
    Parameter,
    Part,
    PhaseSpan,
    Quantity,
    RoleSpec,
    StateSpan,
    While,
    Whole,
)
from safestage_eval.rules.syntax_builder import Builder
from safestage_eval.units import DIMENSIONS, ZERO

names = st.from_regex(r"[a-z][a-z0-9_]{0,6}", fullmatch=True).filter(
    lambda name: name not in ("start", "end", "success", "episode", "first", "last", "from")
)
calls = st.builds(Call, names, st.lists(names, max_size=3).map(tuple))
events = st.one_of(
    st.builds(Event, st.sampled_from(["start", "end", "success"])),
    st.builds(Event, st.just("state"), calls, st.sampled_from([None, "start", "end"])),
)
durations = st.one_of(
    st.builds(lambda n: Duration(n / 8), st.integers(0, 80)),
    st.builds(lambda n: Duration(float(n), frames=True), st.integers(0, 50)),
    st.builds(Parameter, names),
)
spans = st.recursive(
    st.one_of(
        st.builds(Whole),
        st.builds(lambda name: PhaseSpan(Call(name, ())), names),
        st.builds(StateSpan, calls),
        st.builds(Around, st.sampled_from(["before", "after"]), durations, events),
        st.builds(FromTo, events, events),
    ),
    lambda inner: st.builds(Part, st.sampled_from(["first", "last"]), durations, inner),
    max_leaves=3,
)
spans = st.one_of(spans, st.builds(While, spans, calls))


def written(node: object) -> str:
    """A piece of syntax as a rule file would say it."""
    match node:
        case Whole():
            return "episode"
        case PhaseSpan(Call(name, ())):
            return name
        case PhaseSpan(call) | StateSpan(call):
            return str(call)
        case Part(which, duration, of):
            return f"{which} {written(duration)} of {written(of)}"
        case Around(which, duration, event):
            return f"{written(duration)} {which} {written(event)}"
        case FromTo(begin, stop):
            return f"from {written(begin)} to {written(stop)}"
        case While(of, call):
            return f"{written(of)} while {call}"
        case Event("state", call, edge):
            return f"{edge} of {call}" if edge else str(call)
        case Event(kind):
            return kind
        case Duration(amount, frames):
            return f"{amount:g} frames" if frames else f"{amount:g} s"
        case Parameter(name, negative):
            return "-" * negative + name
    raise AssertionError(node)


@given(spans)
def test_spans_read_back(span: object) -> None:
    assert string_parser.span(written(span)) == span
    pattern = schema()["properties"]["baseline"]["properties"]["span"]["pattern"]
    assert re.search(pattern, written(span))


@given(events)
def test_events_read_back(event: Event) -> None:
    assert string_parser.event(written(event)) == event


@given(
    st.integers(-10_000, 10_000),
    st.sampled_from(sorted(d for d in DIMENSIONS if DIMENSIONS[d])),
    st.data(),
)
def test_every_unit_reads_as_si(number: int, dimension: str, data: st.DataObject) -> None:
    unit, factor = data.draw(st.sampled_from(sorted(DIMENSIONS[dimension].items())))
    value = number / 8
    assert string_parser.quantity(f"{value} {unit}") == Quantity(
        value * factor + ZERO.get(unit, 0), dimension
    )


@given(st.sampled_from([">=", "<=", ">", "<"]), names, names, st.booleans())
def test_limits_name_parameters_and_columns(op: str, name: str, role: str, minus: bool) -> None:
    sign = "-" * minus
    assert string_parser.limit(f"{op} {sign}{name}") == Limit(op, Parameter(name, minus))
    assert string_parser.limit(f"{op} {sign}{name}({role})") == Limit(op, Column(name, role, minus))
    assert string_parser.limit(f"{op} {sign}2 cm") == Limit(
        op, Quantity(-0.02 if minus else 0.02, "length")
    )


def test_durations() -> None:
    assert string_parser.duration("20 ms") == Duration(0.02)
    assert string_parser.duration("1.5 min") == Duration(90.0)
    assert string_parser.duration("3 frames") == Duration(3, frames=True)
    several = string_parser.duration("3 frames @ 120 Hz")
    assert several == Duration(0.025, least=2)
    assert string_parser.duration("1 frame @ 100 Hz") == Duration(0.01, least=1)


def test_settings_are_quantities_or_durations() -> None:
    assert string_parser.setting("5 s") == Duration(5.0)
    assert string_parser.setting("1 frame") == Duration(1, frames=True)
    assert (
        string_parser.setting("50 %") == string_parser.setting(0.5) == string_parser.setting("0.5")
    )
    assert string_parser.setting("-5 cm") == Quantity(-0.05, "length")


@pytest.mark.parametrize(
    ("text", "spec"),
    [
        ("object", RoleSpec("object")),
        ("every fixture", RoleSpec("fixture", every=True)),
        ("object tagged fragile", RoleSpec("object", tag="fragile")),
        (
            "every object tagged fragile except target, support",
            RoleSpec("object", every=True, tag="fragile", excluding=("target", "support")),
        ),
    ],
)
def test_roles(text: str, spec: RoleSpec) -> None:
    assert string_parser.role(text) == spec


def test_counts() -> None:
    assert string_parser.count("at least 2 fruit") == ("least", 2, "fruit")
    assert string_parser.count("at most 1 fruit") == ("most", 1, "fruit")
    assert string_parser.count("2 fruit") is None


def test_a_phase_is_distinguished_from_a_state_by_its_declaration() -> None:
    builder = Builder(frozenset({"settle"}))
    assert builder.span("settle(a)") == PhaseSpan(Call("settle", ("a",)))
    assert builder.span("last 1 s of settle(a) while held(a)") == While(
        Part("last", Duration(1.0), PhaseSpan(Call("settle", ("a",)))), Call("held", ("a",))
    )
    assert builder.span("held(a)") == StateSpan(Call("held", ("a",)))


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (string_parser.quantity, "8 parsec"),
        (string_parser.quantity, "eight cm"),
        (string_parser.quantity, "1e3 cm"),
        (string_parser.quantity, "__import__('os')"),
        (string_parser.duration, "3 frames @ 0 Hz"),
        (string_parser.duration, "0.5 frames"),
        (string_parser.duration, "1 s @ 120 Hz"),
        (string_parser.duration, "-1 s"),
        (string_parser.call, "clearance(a, b"),
        (string_parser.call, "Clearance(a)"),
        (string_parser.call, "clearance(a,)"),
        (string_parser.event, "middle of held(a)"),
        (string_parser.event, "held"),
        (string_parser.span, "first of hold"),
        (string_parser.span, "from start"),
        (string_parser.span, "last 1 s before hold"),
        (string_parser.span, "hold while held"),
        (string_parser.limit, "== 5 cm"),
        (string_parser.limit, ">= "),
        (string_parser.limit, ">= 5 cm and <= 6 cm"),
        (string_parser.limit, ">= column(a, b)"),
        (string_parser.role, "objects"),
        (string_parser.role, "object except"),
        (string_parser.atom_key, "held(a) while held(b)"),
        (string_parser.atom_key, "held(a) since noon"),
    ],
)
def test_refused(read, text: str) -> None:
    with pytest.raises(string_parser.GrammarError) as caught:
        read(text)
    assert caught.value.allowed


@given(st.text("abc(), @5.-><=%cmsofwhile", max_size=25))
def test_nothing_but_a_grammar_error_comes_of_any_text(text: str) -> None:
    for read in (
        string_parser.limit,
        string_parser.event,
        string_parser.span,
        string_parser.role,
        string_parser.duration,
        string_parser.setting,
    ):
        try:
            read(text)
        except string_parser.GrammarError as error:
            assert error.what


@pytest.mark.parametrize("text", ["1s", "1 s", "1000ms", "1000 ms"])
def test_a_time_is_a_duration_with_or_without_a_space(text: str) -> None:
    assert string_parser.setting(text) == Duration(1.0)


def test_no_time_is_negative() -> None:
    with pytest.raises(string_parser.GrammarError, match="less than no time"):
        string_parser.setting("-1 s")


@pytest.mark.parametrize("deeper", ["first 1 s of {}", "{} while held(a)"])
def test_spans_within_spans_have_an_end(deeper: str) -> None:
    def nested(depth: int) -> str:
        text = "episode"
        for _ in range(depth):
            text = deeper.format(text)
        return text

    string_parser.span(nested(string_parser.DEEPEST))
    for depth in (string_parser.DEEPEST + 1, 2000):
        with pytest.raises(string_parser.GrammarError, match="parts of parts of a span"):
            string_parser.span(nested(depth))


@pytest.mark.parametrize(
    "text, name, bodies",
    [
        ("lift(cubeA)", "lift", ("cubeA",)),
        ("clearance(milk-1, robot0_link3)", "clearance", ("milk-1", "robot0_link3")),
        ("clearance('the tray', \"a, b\")", "clearance", ("the tray", "a, b")),
        ("tilt(model:obj/0.1)", "tilt", ("model:obj/0.1",)),
        ("gripper_opening()", "gripper_opening", ()),
    ],
)
def test_a_question_names_bodies_as_other_simulators_do(text, name, bodies):
    assert string_parser.query(text) == Call(name, bodies)


@pytest.mark.parametrize(
    "text", ["lift(cube A)", "lift(cubeA", "Lift(a)", "lift('a)", "lift(a) > 1"]
)
def test_what_is_no_question(text):
    with pytest.raises(string_parser.GrammarError):
        string_parser.query(text)


@pytest.mark.parametrize(
    ("text", "body"),
    [("lift(cubeA)", "cubeA"), ("clearance(target, milk-1) since success", "milk-1")],
)
def test_a_body_in_a_rule_must_play_a_role(text, body):
    with pytest.raises(string_parser.GrammarError) as caught:
        string_parser.atom_key(text)
    assert "cannot name a role" in caught.value.what
    assert body in caught.value.allowed


@given(call=calls)
def test_a_question_about_roles_is_a_call(call):
    assert string_parser.query(str(call)) == call
