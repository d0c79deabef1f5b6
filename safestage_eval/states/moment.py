"""When something begins or ends, as far as it is known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from safestage_eval.episode.runs import runs

from .band import Band, Bool


class Truth(NamedTuple):
    """The frames (T,) at which something certainly holds, and at which it may."""

    sure: Bool
    possible: Bool

    @property
    def known(self) -> bool:
        """Nothing about it is open."""
        return self.sure is self.possible or bool((self.sure == self.possible).all())


class Moment(NamedTuple):
    """It happens at one frame from ``first`` to ``last``, both included; or, if not sure, perhaps."""

    first: int
    last: int
    sure: bool = True

    @property
    def known(self) -> bool:
        """It certainly happens, and at one known frame."""
        return self.sure and self.first == self.last


def truth_of(band: Band) -> Truth:
    """Where a margin is certainly, and possibly, at least 0."""
    return Truth(band.true, ~band.false)


def before(truth: Truth) -> Truth:
    """At each frame what holds at the one before; nothing before the first."""
    sure = np.zeros(len(truth.sure), np.bool_)
    sure[1:] = truth.sure[:-1]
    if truth.sure is truth.possible:
        return Truth(sure, sure)
    possible = np.zeros(len(sure), np.bool_)
    possible[1:] = truth.possible[:-1]
    return Truth(sure, possible)


def edges(truth: Truth, edge: str) -> Truth:
    """The frames at which something starts (``start``) to hold, or has just ended to (``end``)."""
    then = before(truth)
    first, second = (truth, then) if edge == "start" else (then, truth)
    return Truth(first.sure & ~second.possible, first.possible & ~second.sure)


def begun_between(truth: Truth, coarse: Bool) -> Truth:
    """The frames of an event; perhaps also those before them, where it came after such a one.

    ``coarse`` (T,): much may happen up to the next sample, so that what the one before the event shows
    may have been so when it came.
    """
    before = np.append(truth.possible[1:], False) & coarse & ~truth.possible
    return Truth(truth.sure, truth.possible | before) if before.any() else truth


def starts(truth: Truth) -> list[Moment]:
    """The beginnings of the stretches in which something holds, in order.

    What holds at the first frame starts there. A possible stretch that holds a certain frame
    begins at that frame at the latest; behind every gap that is not known it may begin again.
    """
    out: list[Moment] = []
    if truth.known:
        return [Moment(int(first), int(first)) for first, _ in runs(truth.sure)]
    for first, stop in runs(truth.possible):
        blocks = first + runs(truth.sure[first:stop])
        if not len(blocks):
            out.append(Moment(int(first), int(stop) - 1, sure=False))
            continue
        out.append(Moment(int(first), int(blocks[0, 0])))
        out += [
            Moment(int(before) + 1, int(begin), sure=False)
            for before, begin in zip(blocks[:-1, 1], blocks[1:, 0], strict=True)
        ]
        if blocks[-1, 1] + 1 < stop:
            out.append(Moment(int(blocks[-1, 1]) + 1, int(stop) - 1, sure=False))
    return out


def ends(truth: Truth) -> list[Moment]:
    """The first frames behind the stretches in which something holds, in order.

    What holds at the last frame has no end.
    """
    frames, out = len(truth.sure), list[Moment]()
    if truth.known:
        return [Moment(int(stop), int(stop)) for _, stop in runs(truth.sure) if stop < frames]
    for first, stop in runs(truth.possible):
        blocks = first + runs(truth.sure[first:stop])
        begin = int(first) if not len(blocks) else int(blocks[-1, 1])
        if len(blocks) and blocks[0, 0] > first + 1:
            out.append(Moment(int(first) + 1, int(blocks[0, 0]) - 1, sure=False))
        out += [
            Moment(int(before), int(after) - 1, sure=False)
            for before, after in zip(blocks[:-1, 1], blocks[1:, 0], strict=True)
        ]
        last = min(int(stop), frames - 1)
        if not len(blocks):
            begin += 1
        if begin <= last:
            out.append(Moment(begin, last, sure=bool(len(blocks)) and stop < frames))
    return out


def frames_of(moments: Sequence[Moment], frames: int) -> Truth:
    """(T,) the frames at which one of the moments certainly, and possibly, is."""
    sure, possible = np.zeros(frames, np.bool_), np.zeros(frames, np.bool_)
    for moment in moments:
        possible[moment.first : moment.last + 1] = True
        if moment.known and moment.first < frames:
            sure[moment.first] = True
    return Truth(sure, possible)
