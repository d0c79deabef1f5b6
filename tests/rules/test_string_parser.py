"""Each production of the grammar: what it means, that it reads back, and what it refuses."""

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.rules import string_parser
from safestage_eval.rules.syntax import (
    Around,
    Call,
    Duration,
    Event,
    FromTo,
    Parameter,
    Part,
    PhaseSpan,
    StateSpan,
    While,
    Whole,
)

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


READERS = {
    "CALL": string_parser.call,
    "EVENT": string_parser.event,
    "DURATION": string_parser.duration,
    "QUANTITY": string_parser.quantity,
    "LIMIT": string_parser.limit,
    "ATOM": string_parser.atom,
    "SPAN": string_parser.span,
    "ROLE": string_parser.role,
}


@settings(max_examples=300)
@given(st.data())
def test_the_parser_reads_what_the_grammar_says(data: st.DataObject) -> None:
    """Schema and documentation have the grammar; the parser takes all of it, but for numbers of no meaning."""
    production = data.draw(st.sampled_from(sorted(READERS)))
    text = data.draw(st.from_regex(string_parser.pattern(production), fullmatch=True))
    try:
        READERS[production](text)
    except string_parser.GrammarError as error:
        reasons = ("too many", "not finite", "must be positive", "shorter time", "parts of parts")
        assert any(reason in f"{error.what} {error.allowed}" for reason in reasons), (
            text,
            error.what,
        )


@given(st.sampled_from(sorted(READERS)), st.text("pq(), @5.-[]><=%cmsofrwhilendtxv", max_size=22))
def test_the_parser_reads_nothing_else(production: str, text: str) -> None:
    try:
        READERS[production](text)
    except string_parser.GrammarError:
        return
    assert re.fullmatch(string_parser.pattern(production), text)


@given(spans)
def test_a_span_reads_back(span: object) -> None:
    assert string_parser.span(written(span)) == span


@given(calls)
def test_a_call_knows_where_its_names_stand(call: Call) -> None:
    text = str(call)
    names = (call.name, *call.args)
    assert [
        text[at : at + len(n)] for at, n in zip(string_parser.call(text).at, names, strict=True)
    ] == [*names]


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
