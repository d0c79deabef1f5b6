"""Whether something is so in the initial state, as far as the first frames of an episode show it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safestage_eval.episode import Clock
from safestage_eval.episode.clock import SURELY
from safestage_eval.errors import RuleError
from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import F64, Band, Bool

from .evaluate import Evaluator
from .values import Env, lasting


class InitialState(NamedTuple):
    """The frames that show it.

    Attributes:
        first, stop: these frames.
        last: the frame behind all those that rules name, which may come late.
        missing: how many of these a hole took away.
        coarse: much may have happened between two of them.
    """

    first: int
    stop: int
    last: int
    missing: int = 0
    coarse: bool = False

    def mask(self, frames: int) -> Bool:
        """(T,) true in all these frames."""
        at = np.arange(frames)
        return np.asarray((at >= self.first) & (at < self.last))

    def most_of(self, band: Band) -> tuple[float, float]:
        """Both ends of the margin with which a condition (T,) holds in most of these frames.

        That it does not must have been seen: what is missing may have shown it, and of samples that are
        far apart one that shows it stands for long enough.
        """
        here = slice(self.first, self.stop)
        low = _middle(band.lower[here])
        high = _middle(np.append(band.upper[here], np.full(self.missing, np.inf)))
        if self.coarse:
            high = max(high, float(band.upper[self.first : self.last].max()))
        return low, high


def _middle(ends: F64) -> float:
    return float(np.sort(ends)[(len(ends) - 1) // 2])


def initial_state(evaluator: Evaluator, env: Env) -> InitialState | None:
    """That of some bodies, each as it first rests; None where the recording begins later."""
    clock, signals = evaluator.clock, evaluator.relations.signals
    if clock.late:
        return None
    first = max((signals.baseline_of(body).start for body in env.values()), default=0)
    named = max(first_frames(evaluator.rules, clock), signals.baseline.asked)
    together = clock.together(first, named)
    last = min(evaluator.frames, first + together)
    coarse = bool(clock.coarse[first : last - 1].any())
    stop = min(last, first + max(signals.baseline.asked, SURELY if coarse else 1))
    return InitialState(first, stop, last, named - together, coarse)


def first_frames(rules: ast.RuleSet, clock: Clock) -> int:
    """How many frames ``[baseline] span`` names.

    Raises RuleError for a span that is not the first stretch of the episode.
    """
    span = rules.baseline
    if (
        isinstance(span, ast.Part)
        and span.which == "first"
        and isinstance(span.of, ast.Whole)
        and isinstance(span.duration, ast.Duration)
    ):
        if span.duration.frames:
            return max(1, round(span.duration.amount))
        return clock.window(lasting(span.duration)).stop(0)
    raise RuleError("[baseline] span", "not a first stretch.", '"first 5 frames of episode"')
