"""When something begins or ends, and the stretches of frames that this leaves to be judged.

Each is as far as it is known: a moment is one of several frames, a scope has frames that are certainly in it
and others that may be.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from safestage_eval.episode.clock import Window
from safestage_eval.episode.runs import runs
from safestage_eval.evidence.intervals import Bool, Interval, crisp

# ---- moments


class Moment(NamedTuple):
    """It happens at one frame from ``first`` to ``last``, both included.

    If it is not sure, it happens at some of these frames or at none.
    """

    first: int
    last: int
    sure: bool = True

    @property
    def known(self) -> bool:
        """It certainly happens, and at one known frame."""
        return self.sure and self.first == self.last


def edges(held: Interval, edge: str) -> Interval:
    """The frames at which something starts (``start``) to hold, or has just ended to (``end``)."""
    now = held.true, held.possible
    # nothing holds before the first frame
    then = tuple(np.concatenate([np.zeros(1, np.bool_), part[:-1]])[: len(part)] for part in now)
    first, second = (now, then) if edge == "start" else (then, now)
    return crisp(first[0] & ~second[1], first[1] & ~second[0])


def starts(held: Interval) -> list[Moment]:
    """The beginnings of the stretches in which something holds, in order.

    What holds at the first frame starts there. A possible stretch that holds a certain frame
    begins at that frame at the latest; behind a gap that is not known it may begin again.
    """
    sure = held.true
    if held.decided:
        return [Moment(first, first) for first, _ in runs(sure).tolist()]
    out: list[Moment] = []
    for first, stop in runs(held.possible).tolist():
        blocks = (first + runs(sure[first:stop])).tolist()
        if not blocks:
            out.append(Moment(first, stop - 1, sure=False))
            continue
        out.append(Moment(first, blocks[0][0]))
        last = stop - 1 if blocks[-1][1] < stop else blocks[-1][0]
        if blocks[0][1] < last:
            out.append(Moment(blocks[0][1] + 1, last, sure=False))
    return out


def ends(held: Interval) -> list[Moment]:
    """The first frames behind the stretches in which something holds, in order.

    What holds at the last frame has no end.
    """
    frames, sure, out = len(held), held.true, list[Moment]()
    if held.decided:
        return [Moment(stop, stop) for _, stop in runs(sure).tolist() if stop < frames]
    for first, stop in runs(held.possible).tolist():
        blocks = (first + runs(sure[first:stop])).tolist()
        begin = blocks[-1][1] if blocks else first + 1
        early = first + 1 if not blocks or blocks[0][0] > first else blocks[0][1]
        if blocks and early < blocks[-1][0]:
            out.append(Moment(early, blocks[-1][0] - 1, sure=False))
        last = min(stop, frames - 1)
        if begin <= last:
            out.append(Moment(begin, last, sure=bool(blocks) and stop < frames))
    return out


def frames_of(moments: Sequence[Moment], frames: int) -> Interval:
    """(T,) where one of the moments is."""
    sure, possible = np.zeros(frames, np.bool_), np.zeros(frames, np.bool_)
    for moment in moments:
        possible[moment.first : moment.last + 1] = True
        if moment.known and moment.first < frames:
            sure[moment.first] = True
    return crisp(sure, possible)


# ---- scopes


class Scope(NamedTuple):
    """The frames [first, stop), and what is not known of them.

    Attributes:
        first, stop: frames outside are certainly not in it.
        cut: the trace ends before it does.
        sure: (stop − first,) which of its frames are certainly in it; None where all of them are.
            A scope without a sure frame may not be there at all, or be several.
    """

    first: int
    stop: int
    cut: bool = False
    sure: Bool | None = None

    @property
    def certain(self) -> Bool:
        """(stop − first,) which of its frames are certainly in it."""
        return np.ones(self.stop - self.first, np.bool_) if self.sure is None else self.sure

    @property
    def exists(self) -> bool:
        """It is certainly there, though perhaps empty."""
        return self.sure is None or bool(self.sure.any())

    def perhaps(self) -> Scope:
        """This scope, without a frame that is certainly in it."""
        return self._replace(sure=np.zeros(self.stop - self.first, np.bool_))


def mask_of(scopes: Iterable[Scope], frames: int) -> Bool:
    """(T,) the frames of some scopes."""
    out = np.zeros(frames, np.bool_)
    for scope in scopes:
        out[scope.first : scope.stop] = True
    return out


def _scope(first: int, stop: int, sure: Bool, *, cut: bool = False) -> Scope:
    return Scope(int(first), int(stop), bool(cut), None if sure.all() and stop > first else sure)


def _pieces(first: int, possible: Bool, sure: Bool, *, cut: bool) -> list[Scope]:
    """The runs of possible frames, counted from a frame; the last may be cut."""
    end = len(possible)
    return [
        _scope(first + a, first + b, sure[a:b], cut=cut and b == end) for a, b in runs(possible)
    ]


def of_truth(held: Interval, *, truncated: bool) -> list[Scope]:
    """Every run of true frames; a run that reaches the end of a truncated trace is cut."""
    return _pieces(0, held.possible, held.true, cut=truncated)


def from_to(on: Interval, off: Interval, *, truncated: bool) -> list[Scope]:
    """From each frame of ``on`` to the next of ``off`` (excluded).

    active(t) = (on(t) or active(t − 1)) and not off(t); where both are true the scope is empty
    but exists, so that it can be counted.
    """
    begins, stops = on.true, off.true
    widest = _from_to(on.possible, stops, truncated=truncated)
    if on.decided and off.decided:
        return widest
    sure = mask_of(_from_to(begins, off.possible, truncated=truncated), len(on))
    return [
        s if s.first == s.stop else _scope(s.first, s.stop, sure[s.first : s.stop], cut=s.cut)
        for s in widest
        if s.first < s.stop or (begins[s.first] and stops[s.first])
    ]


def _from_to(on: Bool, off: Bool, *, truncated: bool) -> list[Scope]:
    frames, stop = len(on), -1
    out: list[Scope] = []
    starts, stops = on.nonzero()[0], off.nonzero()[0]
    while (i := starts.searchsorted(stop + 1)) < len(starts):
        first = int(starts[i])
        j = stops.searchsorted(first)
        if j == len(stops):
            return [*out, Scope(first, frames, truncated)]
        stop = int(stops[j])
        out.append(Scope(first, stop))
    return out


def first_part(scopes: Sequence[Scope], window: Window) -> list[Scope]:
    """The first frames of each, for a duration."""
    out = []
    for first, stop, cut, sure in scopes:
        end = until_ = window.stop(first)
        if sure is not None:
            # it may begin at its first frame, and behind every frame that is not certainly in it
            hidden = np.flatnonzero(~sure[:-1])
            until_ = max(end, window.stop(first + int(hidden[-1]) + 1)) if len(hidden) else end
        last = min(until_, stop)
        early = None if sure is None else (sure & (np.arange(first, stop) < end))[: last - first]
        out.append(Scope(first, last, cut and until_ > stop, early))
    return out


def last_part(scopes: Sequence[Scope], window: Window) -> list[Scope]:
    """The last frames of each, for a duration; of a cut scope the last frames are not known at all."""
    out = []
    for first, stop, cut, sure in scopes:
        begin = from_ = stop if cut else window.first(stop)
        if sure is not None:
            hidden = np.flatnonzero(~sure[1:])
            from_ = min(begin, window.first(first + int(hidden[0]) + 1)) if len(hidden) else begin
        from_ = max(first, from_)
        late = None if sure is None else (sure & (np.arange(first, stop) >= begin))[from_ - first :]
        if sure is None or from_ < stop:
            out.append(Scope(from_, stop, cut and sure is None, late))
        if cut and sure is not None:
            out.append(Scope(stop, stop, True))
    return out


def at(moments: Sequence[Moment]) -> list[Scope]:
    """The one frame of each moment."""
    scopes = [(m, Scope(m.first, m.last + 1)) for m in moments]
    return [scope if moment.known else scope.perhaps() for moment, scope in scopes]


def after(moments: Sequence[Moment], window: Window, total: int) -> list[Scope]:
    """The frames from each moment on, for a duration."""
    return [
        _around(m, m.first, window.stop(m.last), m.last, window.stop(m.first), total,
                cut=window.stop(m.last) > total)
        for m in moments
    ]  # fmt: skip


def before(moments: Sequence[Moment], window: Window, *, cut: bool = False) -> list[Scope]:
    """The frames before each moment (as many as there are), for a duration."""
    return [
        _around(m, window.first(m.first), m.last, window.first(m.last), m.first, m.last, cut=cut)
        for m in moments
    ]


def _around(
    moment: Moment, first: int, stop: int, surely: int, until: int, total: int, *, cut: bool
) -> Scope:
    """[first, stop), of which [surely, until) is certain if the moment is; within [0, total)."""
    first, stop = max(0, first), min(stop, total)
    if moment.known:
        return Scope(first, stop, cut)
    frames = np.arange(first, stop)
    return Scope(first, stop, cut, (frames >= surely) & (frames < until) & moment.sure)


def within(scopes: Sequence[Scope], held: Interval) -> list[Scope]:
    """The frames of each scope in which something holds; a cut scope stays cut at its end."""
    out, sure, possible = list[Scope](), held.true, held.possible
    for scope in scopes:
        first, stop, cut, _ = scope
        inside = sure[first:stop] & scope.certain
        inner = _pieces(first, possible[first:stop], inside, cut=cut)
        if cut and not (inner and inner[-1].stop == stop):
            inner.append(Scope(stop, stop, True))
        out += inner
    return out


def until(scopes: Sequence[Scope], stop_at: Interval) -> list[Scope]:
    """Each scope up to the first frame of ``stop_at`` in it (excluded)."""
    out, surely, perhaps = list[Scope](), stop_at.true, stop_at.possible
    for scope in scopes:
        first, stop, cut, sure = scope
        hits = perhaps[first:stop].nonzero()[0]
        ends = (surely[first:stop] & scope.certain).nonzero()[0]
        if not len(hits):
            out.append(scope)
        elif sure is None and len(ends) and hits[0] == ends[0]:
            out.append(Scope(first, first + int(hits[0])))
        else:
            inside, possible = scope.certain.copy(), np.ones(stop - first, np.bool_)
            inside[hits[0] :] = False
            if len(ends):
                # what certainly ends may begin anew only behind a frame that is not certain
                again = np.flatnonzero(~scope.certain[ends[0] :])
                possible[ends[0] : ends[0] + again[0] + 1 if len(again) else None] = False
            out += _pieces(first, possible, inside, cut=cut)
    return out
