"""At which values of a parameter a rule's verdict on an episode changes.

The verdict is a step function of the value. From the value that holds, the parameter is moved up, and
then down: the evaluator gives the verdict, keys (``flip_keys``) say from where on it may be another,
and there it is judged again, up to ``MOST`` steps. What cannot be followed is left undecided.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from safestage_eval.rules import syntax as ast
from safestage_eval.rules.syntax import amount
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.players import combinations
from safestage_eval.verdicts.stretches import applies, stretches
from safestage_eval.verdicts.verdict import VerdictName

from .flip_bands import FlipBands
from .flip_case import Case
from .flip_clauses import given_keys, instance_keys, keys_within
from .flip_durations import duration_pieces
from .flip_keys import LARGEST, Way, value_of
from .flip_lasting import Undecided
from .flip_scopes import frames_of

MOST = 16
"""Steps from the value that holds, each way."""

FURTHER = 2.0
"""Factor on the limit that holds, up to which distances are compared with limits."""


class Piece(NamedTuple):
    """The values [low, high) of a parameter, all of which give the same verdict.

    Attributes:
        low, high: SI; seconds or frames for a duration.
        verdict: None where it has to be judged again.
        at_risk: whether the hazard was there (``verdict.at_risk``).
    """

    low: float
    high: float
    verdict: VerdictName | None
    at_risk: bool = False

    def holds(self, value: ast.Setting, usual: ast.Setting) -> bool:
        """The value is one of them; ``usual``: of the kind that they are of."""
        match value, usual:
            case ast.Duration(), ast.Duration() if value.frames != usual.frames or value.least > 1:
                return False
        return self.low <= amount(value) < self.high


class Keys(NamedTuple):
    """Truths about a rule at a value, as keys.

    Attributes:
        violated: it is certainly violated.
        open: it is not certainly kept.
        applies: it may be about some bodies.
        steady: size up to which nothing else changes that a verdict tells of.
    """

    violated: float
    open: float
    applies: float
    steady: float = np.inf

    @property
    def verdict(self) -> VerdictName:
        """At the value itself."""
        if self.applies < 0:
            return "not_applicable"
        return "violation" if self.violated >= 0 else "inconclusive" if self.open >= 0 else "pass"

    @property
    def size(self) -> float:
        """Size of the key up to which the verdict stays."""
        sizes = {
            "not_applicable": (self.applies,),
            "violation": (self.violated, self.applies),
            "inconclusive": (self.violated, self.open, self.applies),
            "pass": (self.violated, self.open, self.applies),
        }[self.verdict]
        return min(*map(abs, sizes), self.steady)


def pieces_of(
    base: Evaluator,
    rule: ast.Rule,
    players: Mapping[str, Sequence[str]],
    param: str,
    further: float = 0.0,
) -> list[Piece]:
    """The verdict of a rule on all values of a parameter from 0 on, in order.

    Args:
        base: the evaluator under the values that hold.
        rule: that reads the parameter.
        players: role → the bodies that play it, none of them empty.
        param: its name.
        further: m, up to where limits of distances are to be decided; at least twice the one that
            holds.
    """
    if base.clock.coarse.any():  # what lies between two samples is not followed
        return _joined([])
    case = Case(base, rule, players, param)
    number = min(max(amount(case.usual), 0.0), LARGEST)  # values below 0 are not followed
    try:
        pieces = duration_pieces(case)
        if pieces is None:
            further = max(FURTHER * number, further) * (1 + 1e-6) + 1e-6
            down, up = _walk(case, number, "down", further), _walk(case, number, "up", further)
            pieces = [*reversed(down), *up]
    except Undecided:
        pieces = []
    return _joined([Piece(*piece) for piece in pieces])


def _walk(
    case: Case, start: float, way: Way, further: float
) -> list[tuple[float, float, VerdictName | None, bool]]:
    """Pieces from a value on, the nearest first."""
    out: list[tuple[float, float, VerdictName | None, bool]] = []
    value = start
    for _ in range(MOST):
        at = case.at(value)
        flips = FlipBands(case.base, at, case.param, value, way, case.counts, further)
        keys = _keys(flips, case)
        verdict: tuple[VerdictName | None, bool] = (None, False)
        if not (flips.capped and (keys.verdict == "inconclusive" or value <= 0)):
            verdict = case.judged(value, at)
            if verdict[0] != keys.verdict:
                verdict = (None, False)
        next_ = value_of(keys.size, way)
        if way == "up":
            high = np.inf if next_ is None else next_
            out.append((value, high, *verdict))
        else:
            low = 0.0 if next_ is None else float(np.nextafter(next_, np.inf))
            deep = flips.capped and low == 0  # at 0 depths are measured as well
            low = float(np.nextafter(0.0, 1.0)) if deep else low
            out.append((low, float(np.nextafter(value, np.inf)), *verdict))
            if deep:
                out.append((0.0, low, *case.judged(0.0)))
        if next_ is None:
            break
        value = next_
    return out


def _keys(flips: FlipBands, case: Case) -> Keys:
    """The keys of the rule at a value."""
    at, rule = flips.at, case.rule
    violated = opened = -np.inf
    envs, steady = list(combinations(rule, case.players)), np.inf
    applying = -np.inf if envs else np.inf
    for env in envs:
        if rule.given is not None and flips.reads(rule.given):
            given = given_keys(flips, rule.given, env)
        else:
            applicable = applies(at, rule, env)
            given = (np.inf if applicable else -np.inf, -np.inf if applicable is False else np.inf)
        applying = max(applying, given[1])
        if given[1] == -np.inf:
            continue
        if any(flips.reads(part) for part in (rule.during, rule.at, rule.until)):
            frames = frames_of(flips, rule, env)
            inside = frames.inside
            steady = min(steady, *(abs(float(end.max(initial=-np.inf))) for end in inside))
            broken_keys = [keys_within(flips, rule, env, frames)]
        else:
            scopes = [scope for scope, _ in stretches(at, rule, env)]
            broken_keys = instance_keys(flips, rule, env, scopes)
        for broken, unkept in broken_keys:
            violated = max(violated, min(given[0], broken))
            opened = max(opened, min(given[1], unkept))
    return Keys(violated, opened, applying, steady)


def _joined(pieces: list[Piece]) -> list[Piece]:
    """All values from 0 on: neighbours that say the same put together, gaps undecided."""
    out: list[Piece] = []
    end = 0.0
    for piece in [*pieces, Piece(np.inf, np.inf, None)]:
        if piece.low > end:
            _append(out, Piece(end, piece.low, None))
        if piece.high > max(piece.low, end):
            _append(out, piece._replace(low=max(piece.low, end)))
        end = max(end, piece.high)
    return out


def _append(out: list[Piece], piece: Piece) -> None:
    if out and out[-1].verdict == piece.verdict and out[-1].at_risk == piece.at_risk:
        out[-1] = out[-1]._replace(high=piece.high)
    else:
        out.append(piece)
