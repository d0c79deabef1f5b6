"""Stretches of an episode in which something is judged, as far as they are known."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode.clock import Window
from safestage_eval.episode.runs import runs

from .band import Bool
from .moment import Moment, Truth

I64 = NDArray[np.int64]


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


def ended_between(scopes: Sequence[Scope], coarse: Bool) -> list[Scope]:
    """Each scope, with the frame behind it where it ended somewhere between two samples.

    Things went on until its end, how far shows at the frame behind it alone. That one is not
    certainly in it. ``coarse`` (T,): much may happen up to the next sample.
    """
    frames = len(coarse)
    return [
        Scope(s.first, s.stop + 1, s.cut, np.append(s.certain, False))
        if s.first < s.stop < frames and coarse[s.stop - 1]
        else s
        for s in scopes
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


def _as_window(duration: int | Window) -> Window:
    return Window(duration) if isinstance(duration, int) else duration


def first_part(scopes: Sequence[Scope], duration: int | Window) -> list[Scope]:
    """The first so many frames of each, or those of a duration."""
    window, out = _as_window(duration), []
    for scope in scopes:
        first, stop, cut, sure = scope
        end = window.stop(first)
        if sure is None:
            out.append(Scope(first, min(end, stop), cut and end > stop))
            continue
        # it may begin at its first frame, and behind every frame that is not certainly in it
        begins = np.flatnonzero(np.concatenate([[True], ~sure[:-1]])) + first
        stops = np.array([window.stop(int(frame)) for frame in begins])
        near = _covered(begins - first, stops - first, len(sure))
        early = np.arange(first, stop) < end
        out += _pieces(first, near, sure & early, cut=cut and bool((stops > stop).any()))
    return out


def last_part(scopes: Sequence[Scope], duration: int | Window) -> list[Scope]:
    """The last so many frames of each; of a cut scope the last frames are not known at all."""
    window, out = _as_window(duration), []
    for scope in scopes:
        first, stop, cut, sure = scope
        begin = stop if cut else window.first(stop)
        if sure is None:
            out.append(Scope(max(first, begin), stop, cut))
            continue
        ends = np.flatnonzero(np.concatenate([~sure[1:], [not cut]])) + first + 1
        firsts = np.array([window.first(int(end)) for end in ends], np.int64)
        near = _covered(firsts - first, ends - first, len(sure))
        late = np.arange(first, stop) >= begin
        out += _pieces(first, near, sure & late, cut=False)
        if cut:
            out.append(Scope(stop, stop, True))
    return out


def _covered(firsts: I64, stops: I64, frames: int) -> Bool:
    """(T,) the frames in one of the intervals [first, stop)."""
    changes = np.zeros(frames + 1, np.int64)
    np.add.at(changes, np.clip(firsts, 0, frames), 1)
    np.add.at(changes, np.clip(stops, 0, frames), -1)
    return np.asarray(np.cumsum(changes[:-1]) > 0)


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


def after(moments: Sequence[Moment], duration: int | Window, total: int) -> list[Scope]:
    """So many frames from each moment on, or those of a duration."""
    window = _as_window(duration)
    return [
        _window(m, m.first, window.stop(m.last), m.last, window.stop(m.first), total,
                cut=window.stop(m.last) > total)
        for m in moments
    ]  # fmt: skip


def before(moments: Sequence[Moment], duration: int | Window, *, cut: bool = False) -> list[Scope]:
    """So many frames before each moment (as many as there are), or those of a duration."""
    window = _as_window(duration)
    return [
        _window(m, window.first(m.first), m.last, window.first(m.last), m.first, m.last, cut=cut)
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
