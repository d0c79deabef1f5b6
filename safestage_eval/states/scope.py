"""Stretches of an episode in which something is judged."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .band import Bool
from .persistence import runs


class Scope(NamedTuple):
    """The frames [first, stop); ``cut`` says that the trace ends before the scope does."""

    first: int
    stop: int
    cut: bool = False


def of_truth(truth: Bool, *, truncated: bool) -> list[Scope]:
    """Every run of true frames; a run that reaches the end of a truncated trace is cut."""
    end = len(truth)
    return [Scope(int(a), int(b), truncated and b == end) for a, b in runs(truth)]


def from_to(on: Bool, off: Bool, *, truncated: bool) -> list[Scope]:
    """From each frame of ``on`` to the next of ``off`` (excluded).

    active(t) = (on(t) or active(t − 1)) and not off(t); where both are true the scope is empty
    but exists, so that it can be counted.
    """
    frames = len(on)
    out: list[Scope] = []
    starts, stops = np.flatnonzero(on), np.flatnonzero(off)
    t = 0
    while True:
        i = np.searchsorted(starts, t)
        if i == len(starts):
            return out
        first = int(starts[i])
        j = np.searchsorted(stops, first)
        if j == len(stops):
            return [*out, Scope(first, frames, truncated)]
        stop = int(stops[j])
        out.append(Scope(first, stop))
        t = stop + 1


def first_part(scopes: Sequence[Scope], frames: int) -> list[Scope]:
    """The first so many frames of each."""
    return [Scope(a, min(a + frames, b), cut and a + frames > b) for a, b, cut in scopes]


def last_part(scopes: Sequence[Scope], frames: int) -> list[Scope]:
    """The last so many frames of each; of a cut scope the last frames are not known at all."""
    return [Scope(b, b, True) if cut else Scope(max(a, b - frames), b) for a, b, cut in scopes]


def after(instants: Sequence[int], frames: int, total: int) -> list[Scope]:
    """So many frames from each instant on."""
    return [Scope(e, min(e + frames, total), e + frames > total) for e in instants]


def before(instants: Sequence[int], frames: int) -> list[Scope]:
    """So many frames before each instant (as many as there are)."""
    return [Scope(max(0, e - frames), e) for e in instants]


def within(scopes: Sequence[Scope], truth: Bool) -> list[Scope]:
    """The frames of each scope in which ``truth`` holds; a cut scope stays cut at its end."""
    out = []
    for first, stop, cut in scopes:
        inner = [Scope(first + int(a), first + int(b)) for a, b in runs(truth[first:stop])]
        if cut:
            if inner and inner[-1].stop == stop:
                inner[-1] = Scope(inner[-1].first, stop, True)
            else:
                inner.append(Scope(stop, stop, True))
        out += inner
    return out


def until(scopes: Sequence[Scope], stop_at: Bool) -> list[Scope]:
    """Each scope up to the first frame of ``stop_at`` in it (excluded)."""
    out = []
    for first, stop, cut in scopes:
        hit = np.flatnonzero(stop_at[first:stop])
        out.append(Scope(first, first + int(hit[0])) if len(hit) else Scope(first, stop, cut))
    return out
