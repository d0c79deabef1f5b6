"""Conversations with a server, kept in a file and played back without one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgpack
import zstandard

from safestage_eval.errors import InputError
from simulate.policy import PolicyError

from .line import Line

SUFFIX = ".talk"

Message = tuple[str, bytes | str]
"""Who (``greeting``, ``asked``, ``answered``) and what."""


class Kept:
    """A connection that also writes all messages into a file."""

    def __init__(self, line: Line, path: Path) -> None:
        """``path``: is made, its folder too."""
        self._line, self.greeting = line, line.greeting
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = zstandard.ZstdCompressor(level=3).stream_writer(path.open("wb"))
        if line.greeting:
            self._note("greeting", line.greeting)

    def ask(self, message: bytes, patience: float) -> bytes | str:
        """Ask, and note both."""
        self._note("asked", message)
        answer = self._line.ask(message, patience)
        self._note("answered", answer)
        return answer

    def _note(self, who: str, message: bytes | str) -> None:
        self._file.write(msgpack.packb((who, message)))

    def close(self) -> None:
        """Hang up and finish the file."""
        self._line.close()
        self._file.close()  # type: ignore[no-untyped-call]


class Played:
    """A line that answers what was answered before, in the same order."""

    def __init__(self, path: Path) -> None:
        """Raises InputError where there is no conversation."""
        self._path, self._said = path, list(messages(path))
        self.greeting = b""
        if self._said and self._said[0][0] == "greeting":
            first = self._said.pop(0)[1]
            self.greeting = first if isinstance(first, bytes) else first.encode()
        self._next = 0

    def ask(self, message: bytes, patience: float) -> bytes | str:  # noqa: ARG002
        """The next answer, whatever is asked; PolicyError when there is none."""
        while self._next < len(self._said):
            who, answer = self._said[self._next]
            self._next += 1
            if who == "answered":
                return answer
        questions = sum(who == "asked" for who, _ in self._said)
        raise PolicyError(
            str(self._path),
            f"the conversation is over after {questions} questions.",
            fix="play it back on the task, seed and prompt that it was kept on",
        )

    def close(self) -> None:
        """Nothing to hang up."""


def messages(path: Path) -> Iterator[Message]:
    """All that was said. Raises InputError for what is no whole file of a conversation."""
    try:
        with path.open("rb") as file, zstandard.ZstdDecompressor().stream_reader(file) as stream:
            yield from msgpack.Unpacker(stream, max_buffer_size=0)
    except FileNotFoundError:
        raise InputError(str(path), "no such conversation.") from None
    except (zstandard.ZstdError, msgpack.UnpackException, ValueError, TypeError) as error:
        raise InputError(str(path), f"not a conversation: {error}.") from None
