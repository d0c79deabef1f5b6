"""Where every key and value of a TOML file stands: the standard parser does not tell.

Works on text that ``tomllib`` has already accepted, so it only has to find things, not to judge
them. TOML 1.0: comments, dotted and quoted keys, inline tables, arrays over several lines,
multi-line strings, ``[[arrays of tables]]`` and their sub-tables.
"""

from __future__ import annotations

import bisect
import itertools
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass

Keys = tuple[str | int, ...]
"""The way to an entry: ``("rule", 0, "require", "speed(target)")``."""

_SPACE = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_BETWEEN = re.compile(r"(?:[ \t\r\n,]|#[^\n]*)*")
LONG = 400
"""Characters of a line that are shown around a problem."""

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR = re.compile(r"[^,\]}\n#]+")
_STRINGS = (
    re.compile(r'"""(?:[^\\]|\\.)*?"{3,5}', re.DOTALL),
    re.compile(r"'''.*?'{3,5}", re.DOTALL),
    re.compile(r'"(?:[^"\\\n]|\\.)*"'),
    re.compile(r"'[^'\n]*'"),
)


@dataclass(frozen=True)
class Spot:
    """A stretch of a file: 1-based line and column, number of characters (on that line)."""

    line: int
    column: int
    length: int


class Locations:
    """The spots of all keys and values of one file."""

    def __init__(self, text: str) -> None:
        """``text`` must be valid TOML."""
        self._text = text
        self._starts = [0, *(m.end() for m in re.finditer("\n", text))]
        self._keys: dict[Keys, tuple[int, int]] = {}
        self._values: dict[Keys, tuple[int, int]] = {}
        self._arrays: dict[Keys, int] = {}
        self._position = 0
        self._file()

    def key(self, path: Sequence[str | int]) -> Spot:
        """Where the key stands; where the nearest table around it does, if it has no key."""
        return self._spot(path, (self._keys, self._values))

    def value(self, path: Sequence[str | int]) -> Spot:
        """Where the value stands; its key, or the nearest table around it, if it is a table."""
        return self._spot(path, (self._values, self._keys))

    def part(self, spot: Spot, first: int, length: int) -> Spot:
        """Some characters of the string at a spot; all of it, where it is written with escapes."""
        start = self._starts[spot.line - 1] + spot.column - 1
        literal = self._text[start : start + spot.length]
        quote = 0 if _BARE_KEY.fullmatch(literal) else 1
        if "\\" in literal or literal[:3] in ('"""', "'''") or first + length + quote > spot.length:
            return spot
        return Spot(spot.line, spot.column + quote + first, length)

    def line(self, number: int) -> str:
        """A line (counted from 1) without its end."""
        first, stop = self._line(number)
        return self._text[first:stop].rstrip("\r")

    def around(self, spot: Spot) -> tuple[str, int]:
        """The line of a spot, or of a very long one a part; how many characters were cut before it."""
        first, stop = self._line(spot.line)
        cut = max(0, spot.column - LONG // 2) if stop - first > LONG else 0
        return self._text[first + cut : min(stop, first + cut + LONG)].rstrip("\r"), cut

    def _line(self, number: int) -> tuple[int, int]:
        """The first character of a line, and the one behind its last."""
        last = number == len(self._starts)
        return self._starts[number - 1], len(self._text) if last else self._starts[number] - 1

    def _spot(
        self, path: Sequence[str | int], tables: Sequence[dict[Keys, tuple[int, int]]]
    ) -> Spot:
        for length in range(len(path), 0, -1):
            for table in tables:
                if place := table.get(tuple(path[:length])):
                    return self._at(*place)
        return Spot(1, 1, 1)

    def _at(self, first: int, stop: int) -> Spot:
        line = bisect.bisect_right(self._starts, first)
        end_of_line = self._starts[line] - 1 if line < len(self._starts) else len(self._text)
        column = first - self._starts[line - 1] + 1
        return Spot(line, column, max(1, min(stop, end_of_line) - first))

    def _file(self) -> None:
        table: Keys = ()
        self._skip()
        while self._position < len(self._text):
            if self._text[self._position] == "[":
                table = self._header()
            else:
                self._entry(table)
            self._skip()

    def _skip(self, what: re.Pattern[str] = _SPACE) -> None:
        match = what.match(self._text, self._position)
        self._position = match.end() if match else self._position

    def _header(self) -> Keys:
        """``[a.b]`` or ``[[a.b]]``: the path of the table that it opens."""
        first = self._position
        repeated = self._text.startswith("[[", first)
        self._position += 2 if repeated else 1
        *parents, (last, _) = self._key_parts()
        path: Keys = ()
        for part, spot in parents:
            path = self._inside((*path, part))
            self._keys.setdefault(path, spot)
        path = (*path, last)
        if repeated:
            self._arrays[path] = self._arrays.get(path, -1) + 1
            self._keys.setdefault(path, (first, self._position))
        path = self._inside(path)
        self._position += 2 if repeated else 1
        self._keys[path] = (first, self._position)
        return path

    def _inside(self, path: Keys) -> Keys:
        """The last element, where the path is that of an array of tables."""
        return (*path, self._arrays[path]) if path in self._arrays else path

    def _key_parts(self) -> list[tuple[str, tuple[int, int]]]:
        """A dotted key: its parts with their spots; the position is then behind it."""
        parts = []
        while True:
            self._skip()
            first = self._position
            quoted = self._string()
            if quoted is None:
                match = _BARE_KEY.match(self._text, first)
                self._position = match.end() if match else first + 1
                part = self._text[first : self._position]
            else:
                bare = "\\" not in quoted and quoted[:3] not in ('"""', "'''")
                part = quoted[1:-1] if bare else tomllib.loads(f"key = {quoted}")["key"]
            parts.append((part, (first, self._position)))
            self._skip()
            if self._text[self._position] != ".":
                return parts
            self._position += 1

    def _entry(self, table: Keys) -> None:
        path = table
        for part, spot in self._key_parts():
            path = (*path, part)
            self._keys.setdefault(path, spot)
        self._position += 1  # the equals sign
        self._skip()
        self._value(path)

    def _value(self, path: Keys) -> None:
        first = self._position
        opening = self._text[first]
        if opening in "[{":
            self._members(path, "]" if opening == "[" else "}")
        elif self._string() is None:
            match = _SCALAR.match(self._text, first)
            self._position = first + len(match[0].rstrip()) if match else first + 1
        self._values[path] = (first, self._position)

    def _members(self, path: Keys, closing: str) -> None:
        """What stands in an array or an inline table."""
        self._position += 1
        for index in itertools.count():
            self._skip(_BETWEEN)
            if self._text[self._position] == closing:
                break
            if closing == "]":
                self._value((*path, index))
            else:
                self._entry(path)
        self._position += 1

    def _string(self) -> str | None:
        """The string literal at the position, which then is behind it; None if there is none."""
        for pattern in _STRINGS:
            match = pattern.match(self._text, self._position)
            if match:
                self._position = match.end()
                return match[0]
        return None
