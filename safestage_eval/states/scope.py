"""Stretches of an episode in which something is judged, as far as they are known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .band import Bool
from .moment import Moment, Truth
from .persistence import runs


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
        """The same scope, of which it is not known whether it is there."""
        return self._replace(sure=np.zeros(self.stop - self.first, np.bool_))


def _scope(first: int, stop: int, sure: Bool, *, cut: bool = False) -> Scope:
    return Scope(int(first), int(stop), bool(cut), None if sure.all() and stop > first else sure)


def of_truth(truth: Truth, *, truncated: bool) -> list[Scope]:
    """Every run of true frames; a run that reaches the end of a truncated trace is cut."""
    end = len(truth.sure)
    return [
        _scope(a, b, truth.sure[a:b], cut=truncated and b == end) for a, b in runs(truth.possible)
    ]


def from_to(on: Truth, off: Truth, *, truncated: bool) -> list[Scope]:
    """From each frame of ``on`` to the next of ``off`` (excluded).

    active(t) = (on(t) or active(t − 1)) and not off(t); where both are true the scope is empty
    but exists, so that it can be counted.
    """
    widest = _from_to(on.possible, off.sure, truncated=truncated)
    if on.known and off.known:
        return widest
    sure = np.zeros(len(on.sure), np.bool_)
    for scope in _from_to(on.sure, off.possible, truncated=truncated):
        sure[scope.first : scope.stop] = True
    return [
        s if s.first == s.stop else _scope(s.first, s.stop, sure[s.first : s.stop], cut=s.cut)
        for s in widest
        if s.first < s.stop or (on.sure[s.first] and off.sure[s.first])
    ]


def _from_to(on: Bool, off: Bool, *, truncated: bool) -> list[Scope]:
    frames = len(on)
    out: list[Scope] = []
    starts, stops = on.nonzero()[0], off.nonzero()[0]
    t = 0
    while True:
        i = starts.searchsorted(t)
        if i == len(starts):
            return out
        first = int(starts[i])
        j = stops.searchsorted(first)
        if j == len(stops):
            return [*out, Scope(first, frames, truncated)]
        stop = int(stops[j])
        out.append(Scope(first, stop))
        t = stop + 1


def first_part(scopes: Sequence[Scope], frames: int) -> list[Scope]:
    """The first so many frames of each."""
    out = []
    for scope in scopes:
        first, stop, cut, sure = scope
        if sure is None:
            out.append(Scope(first, min(first + frames, stop), cut and first + frames > stop))
            continue
        # it may begin at its first frame, and behind every frame that is not certainly in it
        begins = np.concatenate([[True], ~sure[:-1]])
        near = _after(begins, frames)
        early = np.arange(len(sure)) < frames
        open_end = cut and bool(begins[max(0, len(sure) - frames + 1) :].any())
        out += _pieces(first, near, sure & early, cut=open_end)
    return out


def last_part(scopes: Sequence[Scope], frames: int) -> list[Scope]:
    """The last so many frames of each; of a cut scope the last frames are not known at all."""
    out = []
    for scope in scopes:
        first, stop, cut, sure = scope
        if sure is None:
            out.append(Scope(stop, stop, True) if cut else Scope(max(first, stop - frames), stop))
            continue
        ends = np.concatenate([~sure[1:], [not cut]])
        near = _after(ends[::-1], frames)[::-1]
        late = np.arange(len(sure))[::-1] < (0 if cut else frames)
        out += _pieces(first, near, sure & late, cut=False)
        if cut:
            out.append(Scope(stop, stop, True))
    return out


def _after(marks: Bool, frames: int) -> Bool:
    """(T,) less than so many frames after a mark, or at it."""
    count = np.concatenate([np.zeros(frames, np.int64), np.cumsum(marks)])
    return np.asarray(count[frames:] > count[: len(marks)])


def _pieces(first: int, possible: Bool, sure: Bool, *, cut: bool) -> list[Scope]:
    """The runs of possible frames, counted from a frame; the last may be cut."""
    end = len(possible)
    return [
        _scope(first + a, first + b, sure[a:b], cut=cut and b == end) for a, b in runs(possible)
    ]


def at(moments: Sequence[Moment]) -> list[Scope]:
    """The one frame of each moment."""
    out = []
    for moment in moments:
        scope = Scope(moment.first, moment.last + 1)
        out.append(scope if moment.known else scope.perhaps())
    return out


def after(moments: Sequence[Moment], frames: int, total: int) -> list[Scope]:
    """So many frames from each moment on."""
    return [
        _window(m, m.first, m.last + frames, m.last, m.first + frames, total,
                cut=m.last + frames > total)
        for m in moments
    ]  # fmt: skip


def before(moments: Sequence[Moment], frames: int, *, cut: bool = False) -> list[Scope]:
    """So many frames before each moment (as many as there are)."""
    return [
        _window(m, m.first - frames, m.last, m.last - frames, m.first, m.last, cut=cut)
        for m in moments
    ]


def _window(
    moment: Moment, first: int, stop: int, surely: int, until: int, total: int, *, cut: bool
) -> Scope:
    """[first, stop), of which [surely, until) is certain if the moment is; within [0, total)."""
    first, stop = max(0, first), min(stop, total)
    if moment.known:
        return Scope(first, stop, cut)
    frames = np.arange(first, stop)
    sure = (frames >= surely) & (frames < until) & moment.sure
    return Scope(first, stop, cut, sure)


def within(scopes: Sequence[Scope], truth: Truth) -> list[Scope]:
    """The frames of each scope in which ``truth`` holds; a cut scope stays cut at its end."""
    out = []
    for scope in scopes:
        first, stop, cut, _ = scope
        inside = truth.sure[first:stop] & scope.certain
        inner = _pieces(first, truth.possible[first:stop], inside, cut=cut)
        if cut and not (inner and inner[-1].stop == stop):
            inner.append(Scope(stop, stop, True))
        out += inner
    return out


def until(scopes: Sequence[Scope], stop_at: Truth) -> list[Scope]:
    """Each scope up to the first frame of ``stop_at`` in it (excluded)."""
    out = []
    for scope in scopes:
        first, stop, cut, sure = scope
        hits = stop_at.possible[first:stop].nonzero()[0]
        ends = (stop_at.sure[first:stop] & scope.certain).nonzero()[0]
        if not len(hits):
            out.append(scope)
        elif sure is None and len(ends) and hits[0] == ends[0]:
            out.append(Scope(first, first + int(hits[0])))
        else:
            inside = scope.certain.copy()
            inside[hits[0] :] = False
            possible = np.ones(stop - first, np.bool_)
            if len(ends):
                # what certainly ends may begin anew only behind a frame that is not certain
                again = np.flatnonzero(~scope.certain[ends[0] :])
                possible[ends[0] : ends[0] + again[0] + 1 if len(again) else None] = False
            out += _pieces(first, possible, inside, cut=cut)
    return out
