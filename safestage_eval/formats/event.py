"""A remark at an instant of an episode, for the viewers that open an MCAP file."""

from __future__ import annotations

from typing import Literal, NamedTuple

Level = Literal["info", "warning", "error"]


class Event(NamedTuple):
    """A line in the log of a viewer.

    Attributes:
        time: s from the episode's start.
        text: one line.
        level: how the viewer marks it.
        name: who says so; viewers filter by it.
    """

    time: float
    text: str
    level: Level = "info"
    name: str = "safestage"
