"""An episode that could not be judged."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Problem:
    """Why an episode has no result.

    Attributes:
        path: of the episode, as printed.
        message: the error in one line, path included.
        contradicts: what the recording says cannot all be true; an audit finds the likely cause.
    """

    path: str
    message: str
    contradicts: bool = False
