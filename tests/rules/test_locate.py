"""The place of every key and value in a TOML file: what stands there is what TOML read."""

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.rules.diagnostic import Diagnostic
from safestage_eval.rules.files import builtin_folder
from safestage_eval.rules.locate import Locations, Spot

HARD = '''
# a comment with = and [brackets]
top = 1   # after it
"quoted key" . inner = 'single # no comment'
a.b.c = """
several
lines [x] = 3"""
path = \'\'\'C:\\here\'\'\'
escaped = "say \\"no\\" # here"
array = [
  1, # one
  [2, 3], { x = 1, y.z = "two" },
  "]", ]
date = 1979-05-27 07:32:00
[ table . "sub table" ]
k = true
[[list]]
n = 1
[list.inner]
m = 2
[[list.deep]]
d = 1
[[list.deep]]
d = 2
[[list]]
n = 3
inner = { m = -4.5e3 }
empty = []
nothing = {}
[table]
late = "x"
'''


def leaves(
    node: Any, path: tuple[str | int, ...] = ()
) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    if isinstance(node, dict):
        for key, value in node.items():
            yield from leaves(value, (*path, key))
    elif isinstance(node, list) and node:
        for index, value in enumerate(node):
            yield from leaves(value, (*path, index))
    else:
        yield path, node


def at(text: str, spot: Spot) -> str:
    lines = text.split("\n")
    first = sum(len(line) + 1 for line in lines[: spot.line - 1]) + spot.column - 1
    return text[first:]


def starts_with(text: str, value: Any) -> bool:
    """Some prefix of the text is a TOML literal of the value."""
    for stop in range(1, len(text) + 1):
        try:
            if tomllib.loads(f"x = {text[:stop]}\n")["x"] == value:
                return True
        except tomllib.TOMLDecodeError:
            continue
    return False


def check(text: str) -> None:
    found = Locations(text)
    for path, value in leaves(tomllib.loads(text)):
        spot = found.value(path)
        assert starts_with(at(text, spot), value), (path, spot)
        key = next(part for part in reversed(path) if isinstance(part, str))
        owner = path[: len(path) - list(reversed(path)).index(key)]
        shown = at(text, found.key(owner))
        assert shown.startswith((key, f'"{key}"', f"'{key}'", "[")), (path, shown[:20])


def test_hard_file() -> None:
    check(HARD)


@pytest.mark.parametrize("path", sorted(builtin_folder().glob("*.toml")), ids=lambda p: p.stem)
def test_builtin_files(path: Path) -> None:
    check(path.read_text("utf-8"))


def test_headers_and_the_nearest_table() -> None:
    found = Locations(HARD)
    line = HARD.split("\n").index
    assert found.key(("list", 1)).line == HARD.split("\n").index("n = 3")
    assert found.key(("list", 0, "inner")) == Spot(line("[list.inner]") + 1, 1, 12)
    assert found.key(("list", 0, "inner", "gone")).line == line("[list.inner]") + 1
    assert found.value(("gone",)) == Spot(1, 1, 1)
    assert found.line(line("k = true") + 1) == "k = true"


def test_a_spot_of_several_lines_ends_with_its_first() -> None:
    assert Locations(HARD).value(("a", "b", "c")).length == 3


scalars = st.one_of(
    st.booleans().map(lambda b: str(b).lower()),
    st.integers(-99, 99).map(str),
    st.text("ab #[]{}=,.", max_size=6).map(lambda s: f'"{s}"'),
    st.text("ab #[]{}=,.", max_size=6).map(lambda s: f"'{s}'"),
    st.text("ab #\n[]=", max_size=6).map(lambda s: f'"""{s}"""'),
)
keys = st.from_regex(r"[a-z]{1,2}", fullmatch=True) | st.text("x .#=[", max_size=3).map(
    lambda s: f'"{s}"'
)
literals = st.recursive(
    scalars,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3).map(lambda items: "[ # c\n" + ",\n ".join(items) + "]"),
        st.dictionaries(keys, inner, max_size=3).map(
            lambda d: "{ " + ", ".join(f"{k} = {v}" for k, v in d.items()) + " }"
        ),
    ),
    max_leaves=6,
)


@given(st.lists(st.tuples(keys, literals), max_size=4, unique_by=lambda kv: kv[0].strip('"')))
def test_any_file(entries: list[tuple[str, str]]) -> None:
    text = "".join(f"  {key}  =  {value} # end\n" for key, value in entries)
    text += "[[rule]]\n" + text + "[rule.sub]\n" + text
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    check(text)


@pytest.mark.parametrize("ending", ["", "\n", "\r\nb = 1\n"])
def test_of_a_very_long_line_what_is_around_a_spot_is_shown(ending: str) -> None:
    text = "before = 0\na = {" + ", ".join(f"key{i} = {i}" for i in range(2000)) + "}" + ending
    found = Locations(text)
    for i in (0, 1, 30, 40, 1000, 1999):
        spot = found.key(("a", f"key{i}"))
        shown, cut = found.around(spot)
        assert len(shown) <= 400
        assert shown[spot.column - 1 - cut :][: spot.length] == f"key{i}"
        place = spot.line, spot.column, "R000", "no", "", ""
        said = Diagnostic("x.toml", *place, shown, spot.length, cut)
        line, caret = said.render().split("\n")[3:5]
        assert line[caret.index("^") : caret.rindex("^") + 1] == f"key{i}"
    short = found.key(("before",))
    assert found.around(short) == ("before = 0", 0)
