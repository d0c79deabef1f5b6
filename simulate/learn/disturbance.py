"""Which control steps of a demonstration are not to be learned, as a note in the episode's header."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

START = "disturbed:"


def disturbance_note(spans: Sequence[tuple[int, int]]) -> tuple[str, ...]:
    """``disturbed: 0-15, 70-75``: first and last control step of each span; no note without any."""
    said = ", ".join(f"{first}-{last}" for first, last in spans)
    return (f"{START} {said}",) if spans else ()


def disturbed(notes: Iterable[str], length: int) -> NDArray[np.bool_]:
    """(length,) whether a control step is in a span of these notes."""
    result = np.zeros(length, bool)
    for note in notes:
        if note.startswith(START):
            for span in note.removeprefix(START).split(","):
                first, _, last = span.strip().partition("-")
                result[int(first) : int(last) + 1] = True
    return result
