"""States that ask for something costly, found out at as few frames as that takes."""

from __future__ import annotations

from abc import abstractmethod
from functools import partial

import numpy as np

from safestage_eval.episode.runs import runs
from safestage_eval.rules import syntax as ast
from safestage_eval.states import persistence
from safestage_eval.states.band import Band, Bool
from safestage_eval.states.masks import followed, last_of, sample, widened
from safestage_eval.states.moment import Truth

from .conditions import Conditions
from .costly import is_for_good
from .values import Env


class PartialStates(Conditions):
    """States at the frames at which they are wanted; at others as far as they are known."""

    @abstractmethod
    def _persistent(self, state: ast.StateDef, margins: Band) -> Band:
        """The margins of a state's condition, made to last."""

    def _partly(
        self, state: ast.StateDef, call: ast.Call, bodies: tuple[str, ...], wanted: Bool
    ) -> Band:
        """A state that asks for something costly, at the wanted frames; unknown at others."""
        env = dict(zip(state.of, bodies, strict=True))
        if self.costly.named(state):
            return self.condition(state.when, env, wanted)
        over = None
        if state.until is not None and self._deep(state.until.call):
            if self._signs:
                since = ("since", call.name, bodies, *self._where(wanted))
                return self.once(state, since, self._since_reset, state, env, wanted)
            over = self._resets(state.until, env, wanted).sure
            wanted = wanted & ~over  # there it is over, whatever it was before
            if not wanted.any():
                return Band(np.full(self.frames, -np.inf), np.where(over, -np.inf, np.inf))
        if self._signs and state.until is not None:
            band = self.signs(call.name, bodies, last_of(wanted))
        else:
            key = ("at", call.name, bodies, self._signs, *self._where(wanted))
            band = self.once(state, key, self._at, state, call.name, bodies, wanted)
        if over is None or not over.any():
            return band
        return Band(*(np.where(over, -np.inf, end) for end in band))

    def _where(self, wanted: Bool) -> tuple[bytes, int]:
        """The part of a cache key that depends on the wanted frames."""
        return wanted.tobytes(), -1 if wanted.any() else self.relations.store.sparse_count

    def _since_reset(self, state: ast.StateDef, env: Env, wanted: Bool) -> Band:
        """Whether a latched state holds at the wanted frames: since its last end before them."""
        assert state.until is not None
        stretches = runs(wanted).tolist()
        starts = np.zeros(self.frames, np.bool_)
        starts[[first for first, _ in stretches]] = True
        over = self._resets(state.until, env, starts).sure
        among = np.zeros(self.frames, np.bool_)
        for first, stop in stretches:
            among[last_of(over[: first + 1]) : stop] = True
        band = self._sparsely(state, env, among)
        return self._latched_signs(band, state.until, env, among, starts)

    def signs(self, name: str, bodies: tuple[str, ...], stop: int | None = None) -> Band:
        """(T,) where a state that asks for something costly holds; its margins mean nothing else.

        What is costly is asked for only where that decides, and only for the frames before ``stop``.
        """
        stop = self.frames if stop is None else stop
        state = self.rules.states[name]
        outer, self._signs, self._obligation = (self._signs, self._obligation), True, None
        try:
            return self.once(
                state, ("signs", name, bodies, stop), self._signs_of, state, name, bodies, stop
            )
        finally:
            self._signs, self._obligation = outer

    def _made_of(self, state: ast.StateDef, env: Env, wanted: Bool) -> Band:
        """Its condition; of what holds for good once it does, as far as that matters."""
        atom = state.when.atoms[0]
        if len(state.when.atoms) == 1 and isinstance(atom, ast.AnyOf) and is_for_good(state):
            return self._any(atom.alternatives, env, wanted, once=True)
        return self.condition(state.when, env, wanted)

    def _signs_of(self, state: ast.StateDef, name: str, bodies: tuple[str, ...], stop: int) -> Band:
        band = self._lasting_signs(state, name, bodies, stop)
        if state.until is None:
            return band
        among = np.arange(self.frames) < stop
        return self._latched_signs(
            band, state.until, dict(zip(state.of, bodies, strict=True)), among
        )

    def _lasting_signs(
        self, state: ast.StateDef, name: str, bodies: tuple[str, ...], stop: int
    ) -> Band:
        """(T,) whether it holds before ``stop``, but for its ``until``."""
        outer, self._signs = self._signs, True
        try:
            env, wanted = dict(zip(state.of, bodies, strict=True)), np.arange(self.frames) < stop
            key = ("lasting signs", name, bodies, stop)
            return self.once(state, key, self._sparsely, state, env, wanted)
        finally:
            self._signs = outer

    def _sparsely(self, state: ast.StateDef, env: Env, wanted: Bool) -> Band:
        """Whether a state lasts at the wanted frames, asked at as few frames as that takes.

        What must last for 12 frames is ruled out by one frame in 12 at which it does not hold.
        """
        lasts, gap = self.window(state.for_), self.open_gap(state.gap)
        if self._reach(state) is None or (gap.frames > 1 and lasts.frames > 1):
            return self._persistent(state, self._made_of(state, env, self.around(state, wanted)))
        some = partial(sample, every=lasts.frames if gap.frames <= 1 else 1)
        ahead = partial(followed, by=max(lasts.frames, gap.frames) - 1)
        frames = np.zeros(self.frames, np.bool_)
        for more in (some, ahead, partial(self.around, state), None):
            band = self._persistent(state, self._made_of(state, env, frames))
            open_ = wanted & band.unknown
            if more is None or not open_.any():
                break
            frames |= more(open_)
        return band

    def _latched_signs(
        self, band: Band, until: ast.Event, env: Env, among: Bool, first: Bool | None = None
    ) -> Band:
        """Whether a latched state holds at some frames; its end is asked for only where it decides.

        ``first``: (T,) where it is asked for anyway.
        """
        if until.edge is not None or not self._deep(until.call):
            return persistence.latched(band, *self.truth(until, env))
        frames, step = np.zeros(self.frames, np.bool_) if first is None else first.copy(), 8
        while True:
            latched = persistence.latched(band, *self._resets(until, env, frames))
            open_ = latched.unknown & among & ~frames
            if not open_.any():
                return latched
            frames[open_.nonzero()[0][:step]] = True
            step *= 8

    def _at(self, state: ast.StateDef, name: str, bodies: tuple[str, ...], wanted: Bool) -> Band:
        env, exact, stop = dict(zip(state.of, bodies, strict=True)), wanted, last_of(wanted)
        if self._signs and state.until is None:
            return self._sparsely(state, env, wanted)
        if state.until is not None:  # its margin is the best since it began to hold
            may = ~self.signs(name, bodies, stop).false
            may[stop:] = False
            exact = wanted | may
        band = self._persistent(state, self._made_of(state, env, self.around(state, exact)))
        if state.until is None:
            return band
        signs = self._lasting_signs(state, name, bodies, stop)
        lower = np.where(exact, band.lower, signs.lower)
        band = Band(lower, np.where(exact, band.upper, signs.upper))
        where = np.logical_or.accumulate(~band.false) | wanted
        where[stop:] = False
        return persistence.latched(band, *self._resets(state.until, env, where))

    def _resets(self, event: ast.Event, env: Env, wanted: Bool) -> Truth:
        """When a latched state ends, at the wanted frames; at others as far as it is known."""
        call = event.call
        if call is None or event.edge is not None or not self._deep(call):
            return self.truth(event, env)
        return self._signs_at(call, env, wanted)

    def around(self, state: ast.StateDef, frames: Bool) -> Bool:
        """(T,) some frames, and those at which a state looks to make it last there."""
        reach = self._reach(state)
        return np.ones(self.frames, np.bool_) if reach is None else widened(frames, reach)

    def _reach(self, state: ast.StateDef) -> int | None:
        """How many frames away a state looks to make it last; None where that differs."""
        lasts, gap = self.window(state.for_), self.open_gap(state.gap)
        if lasts.stops is not None or gap.stops is not None:
            return None
        return lasts.frames + gap.frames
