"""Missing facts of a source, collected: one run names everything that the user has to supply."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from .importer import SourceError

Value = TypeVar("Value")


class Gaps:
    """Collects the SourceErrors of one episode."""

    def __init__(self, where: str, noted: list[SourceError] | None = None) -> None:
        """``where``: the source, as messages say it; ``noted``: receives what is missing instead of refusing."""
        self._where, self._noted = where, noted
        self._found: list[SourceError] = []

    def ask(self, call: Callable[[], Value], meanwhile: Value) -> Value:
        """Return what a call returns; if it lacks something, note that and go on with another value."""
        try:
            return call()
        except SourceError as error:
            self._found.append(error)
            return meanwhile

    def refuse(self) -> None:
        """Raise SourceError if anything is missing, with all of it, each with its fix."""
        if self._noted is not None:
            self._noted += self._found
            return
        if len(self._found) < 2:
            for error in self._found:
                raise error
            return
        gaps = " ".join(f"({i}) {error}" for i, error in enumerate(self._found, 1))
        raise SourceError(self._where, f"lacks {len(self._found)} things: {gaps}")
