"""The tables, keys and words around a position of a rule file that is being typed.

The text need not be valid TOML: a string ends with its line, an inline table too, and a header or an
entry ends an array that was left open.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from safestage_eval.rules.diagnostic import RuleErrors
from safestage_eval.rules.files import parsed
from safestage_eval.rules.locate import Keys
from safestage_eval.rules.table_keys import TOP

_TOKEN = re.compile(
    r'''(?P<blank>[ \t\r]+)|(?P<line>\n)|(?P<comment>\#[^\n]*)
    |(?P<string>"""(?:[^\\]|\\.)*?(?:"{3,5}|\Z)|\'\'\'.*?(?:\'{3,5}|\Z)
    |"(?:[^"\\\n]|\\[^\n])*"?|'[^'\n]*'?)
    |(?P<mark>[\[\]{}=,])|(?P<bare>[^\s\#"'\[\]{}=,]+)|(?P<other>.)''',
    re.VERBOSE | re.DOTALL,
)
_HEADER = re.compile(rf"\[\[?[ \t]*(?:{'|'.join(TOP)})\b[^\n]*")
_ANY_HEADER = re.compile(r"\[\[?[^\n]*")
_PART = re.compile(r"""[\w-]+|"[^"\n]*"|'[^'\n]*'""")

MOST_REPAIRS = 25
"""Lines that are left out of a text until the rest is valid TOML."""


@dataclass(frozen=True)
class Place:
    """Where a cursor stands.

    Attributes:
        path: to the table or array around it; with the key of the entry whose value it stands in.
        what: ``key`` or ``value`` is being written, the name of a ``table`` in its header, or ``nothing``
            (a comment, or behind a value).
        before: what of it stands before the cursor, without the opening quote.
        quoted: it stands in a string.
        keys: those of the entries before it in the table or inline table that the entry is in.
    """

    path: Keys
    what: Literal["key", "value", "table", "nothing"]
    before: str = ""
    quoted: bool = False
    keys: tuple[str, ...] = ()


@dataclass
class _Frame:
    """A table, an inline table or an array that is open."""

    kind: Literal["table", "inline", "array"]
    path: Keys
    parts: tuple[str, ...] = ()
    state: Literal["key", "value", "done"] = "key"
    index: int = 0
    keys: list[str] = field(default_factory=list)

    @property
    def value_path(self) -> Keys:
        return (*self.path, self.index) if self.kind == "array" else (*self.path, *self.parts)

    def next_entry(self) -> None:
        self.parts, self.state, self.index = (), "key", self.index + 1


@dataclass
class _Scan:
    """Reads tokens up to the cursor."""

    frames: list[_Frame] = field(default_factory=lambda: [_Frame("table", ())])
    arrays: dict[Keys, int] = field(default_factory=dict)
    last: str = ""

    def place(self, before: str = "", *, quoted: bool = False) -> Place:
        top = self.frames[-1]
        if top.state == "done":
            return Place(top.path, "nothing", before)
        keys = tuple(top.keys)
        if top.kind != "array" and top.state == "key":
            return Place(top.path, "key", before, quoted, keys)
        return Place(top.value_path, "value", before, quoted, keys)

    def header(self, text: str) -> None:
        """``[a.b]`` or ``[[a.b]]`` opens a table."""
        repeated = text.startswith("[[")
        names = [part.strip("\"'") for part in _PART.findall(text.partition("]")[0])]
        path: Keys = ()
        for at, name in enumerate(names):
            path = (*path, name)
            if at == len(names) - 1 and repeated:
                self.arrays[path] = self.arrays.get(path, -1) + 1
            if path in self.arrays:
                path = (*path, self.arrays[path])
        self.frames = [_Frame("table", path, state="done")]

    def word(self, text: str) -> None:
        """A string or a bare word."""
        top, self.last = self.frames[-1], text
        if top.kind != "array" and top.state == "key":
            names = [text.strip("\"'")] if text[0] in "\"'" else text.strip(".").split(".")
            top.parts = (*top.parts, *names)
        else:
            top.state = "done"

    def mark(self, text: str) -> None:
        """A bracket, a comma or an equals sign."""
        top = self.frames[-1]
        if text == "=":
            if top.kind == "array":  # left open: an entry begins
                self.frames = self.frames[:1]
                self.frames[0].next_entry()
                self.word(self.last or "key")
            self.frames[-1].state = "value"
            self.frames[-1].keys.append(".".join(self.frames[-1].parts))
        elif text == ",":
            top.next_entry()
        elif text in "[{":
            self.frames.append(_Frame("array" if text == "[" else "inline", top.value_path))
        elif len(self.frames) > 1:
            self.frames.pop()
            self.frames[-1].state = "done"

    def line(self) -> None:
        """A line ends, and with it what cannot go on in the next one."""
        while self.frames[-1].kind == "inline":
            self.frames.pop()
            self.frames[-1].state = "done"
        if self.frames[-1].kind == "table":
            self.frames[-1].next_entry()


def place_at(text: str, offset: int) -> Place:
    """Find the table, key and word at a position, ``offset`` characters from the start of the text."""
    scan = _Scan()
    at, fresh = 0, True  # fresh: nothing but space before it on its line
    while at < offset:
        top = scan.frames[-1]
        header = _HEADER if top.kind == "array" else _ANY_HEADER
        if fresh and text[at] == "[" and (match := header.match(text, at)):
            if offset <= match.end():
                inside = text[at:offset]
                what: Literal["table", "nothing"] = "nothing" if "]" in inside else "table"
                return Place((), what, inside.lstrip("[").lstrip())
            scan.header(match[0])
            at = match.end()
            continue
        token = _TOKEN.match(text, at)
        assert token is not None
        kind, stop = token.lastgroup, token.end()
        fresh = kind == "line" or (fresh and kind == "blank")
        if kind in ("string", "bare", "comment") and offset <= stop:
            inside = text[at:offset]
            if kind == "comment":
                return Place((), "nothing")
            if kind == "bare":
                return scan.place(inside)
            if offset < stop or not _closed(token[0]):
                quote = 3 if inside[:3] in ('"""', "'''") else 1
                return scan.place(inside[quote:], quoted=True)
        if kind in ("string", "bare"):
            scan.word(token[0])
        elif kind == "mark":
            scan.mark(token[0])
        elif kind == "line":
            scan.line()
        at = stop
    return scan.place()


def _closed(string: str) -> bool:
    quote = string[:3] if string[:3] in ('"""', "'''") else string[0]
    return len(string) >= 2 * len(quote) and string.endswith(quote)


def readable(text: str) -> str | None:
    """The text without the lines that keep it from being TOML; None if too many do."""
    lines = text.split("\n")
    for _ in range(MOST_REPAIRS):
        attempt = "\n".join(lines)
        try:
            parsed(attempt, "")
        except RuleErrors as error:
            wrong = _said_before(lines, error.diagnostics[0].line)
            if wrong is None:
                return None
            lines[wrong] = ""
        else:
            return attempt
    return None


def _said_before(lines: list[str], number: int) -> int | None:
    """The index of the last line up to ``number`` (counted from 1) that is not empty."""
    return next((n for n in range(min(number, len(lines)) - 1, -1, -1) if lines[n].strip()), None)


def words_around(text: str, offset: int) -> Iterator[tuple[int, int]]:
    """Start and end of the words at a position, the longest first: ``m/s``, ``m``."""
    for pattern in (r"[\w/^%]+", r"\w+"):
        for match in re.finditer(pattern, text):
            if match.start() <= offset <= match.end():
                yield match.span()
