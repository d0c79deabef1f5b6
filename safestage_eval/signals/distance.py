"""Signals of where bodies are relative to each other: from poses and geometry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.geometry.extent import highest, lowest
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.shape import BodyShape

from .reference import Reference

F64 = NDArray[np.float64]


class Movers:
    """The bodies of an episode as shapes along their poses, built when first asked for."""

    def __init__(self, episode: Episode) -> None:
        """Nothing is loaded yet."""
        self._episode = episode
        self._movers: dict[str, Mover] = {}

    def __getitem__(self, name: str) -> Mover:
        """The body's shape and poses (one pose for a fixed body)."""
        if name not in self._movers:
            track = self._episode.tracks[name]
            shape = BodyShape.build(self._episode.bodies[name], self._episode.meshes)
            self._movers[name] = Mover.build(shape, track.position, track.orientation)
        return self._movers[name]

    def of(self, names: Sequence[str]) -> list[Mover]:
        """Those of the bodies that have geometry."""
        return [self[name] for name in names if self._episode.bodies[name].geoms]


def lift(mover: Mover, frames: int, reference: Reference) -> F64:
    """(T,) m, lowest point above the lowest point at the reference."""
    low = np.broadcast_to(lowest(mover), frames)
    initial = np.median(low[: reference.baseline.frames], keepdims=True)
    return low - reference.of(low[:, None], initial)[:, 0]


def height_above(a: Sequence[Mover], b: Sequence[Mover], frames: int) -> F64:
    """(T,) m, lowest point of a union above the highest point of another."""
    low = np.minimum.reduce([np.broadcast_to(lowest(m), frames) for m in a])
    high = np.maximum.reduce([np.broadcast_to(highest(m), frames) for m in b])
    difference: F64 = low - high
    return difference
