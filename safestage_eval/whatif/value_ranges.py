"""The verdict of a rule on all values of a parameter: proved for whole ranges, judged where it changes.

A verdict that comes out alike for a whole range of values (``verdicts.ranges``) holds for all of them. A limit
can only change a verdict at a value that was measured, so ranges are cut there alone: first where the verdict
that holds was decided, then in the middle. What is not decided after a few cuts stays open: judge it again.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from safestage_eval.evidence.intervals import F64
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.syntax import amount
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.obligations import judge_instances
from safestage_eval.verdicts.players import combinations
from safestage_eval.verdicts.ranges import Range, Seen, Undecided
from safestage_eval.verdicts.scopes import applies
from safestage_eval.verdicts.verdict import VerdictName

from .judge_again import Again
from .swept_values import like

FURTHER = 2.0
"""Factor on the limit that holds, up to which distances are compared with limits."""

MOST = 16
"""Ranges that are tried for one rule and parameter."""

Said = tuple[VerdictName, bool]
"""A verdict, and whether the hazard was there."""


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


def all_pieces(
    again: Again, rule: ast.Scoped, params: Sequence[str], further: float = 0.0
) -> dict[str, list[Piece]]:
    """Each parameter → the verdict of a rule on all its values from 0 on, in order.

    Args:
        again: the episode.
        rule: that reads the parameters.
        params: names.
        further: m, up to where limits of distances are to be decided; at least twice the one that
            holds.
    """
    if not all(again.players(rule).values()):  # whatever the values
        return {param: [Piece(0.0, np.inf, again.usual(rule).verdict)] for param in params}
    if not isinstance(rule, ast.Rule) or again.evaluator(rule).clock.coarse.any():
        return {param: [Piece(0.0, np.inf, None)] for param in params}
    out = {param: [Piece(0.0, np.inf, None)] for param in params}
    follow = [param for param in params if not again.moves_success(param)]
    if follow:
        over = _OverRanges(again, rule, further)
        settled = over.settled(follow)
        for param in follow:
            said = settled.get(param)
            out[param] = over.pieces(param) if said is None else [Piece(0.0, np.inf, *said)]
    return out


class _OverRanges:
    """One rule on one episode, under ranges of values."""

    def __init__(self, again: Again, rule: ast.Rule, further: float) -> None:
        self._again, self._rule, self._further = again, rule, further
        self._evaluator = again.evaluator(rule)
        self._seen: dict[str, Seen] = defaultdict(Seen)
        self._usual: Mapping[str, Any] = self._evaluator.params
        self._decisive = again.under(rule, {}).value

    def settled(self, params: Sequence[str]) -> dict[str, Said]:
        """The parameters on which the verdict does not hang at all, found by halving their list."""
        said = self._said({param: self._range(param, 0.0, np.inf) for param in params})
        if said is not None:
            return dict.fromkeys(params, said)
        if len(params) == 1:
            return {}
        middle = len(params) // 2
        return {**self.settled(params[:middle]), **self.settled(params[middle:])}

    def pieces(self, param: str) -> list[Piece]:
        """The verdict on all values of a parameter, which is not the same on all of them."""
        usual, seen = self._usual[param], self._seen[param]
        held = max(amount(usual), 0.0)
        cuts, left, out = _cuts(seen), MOST, list[Piece]()
        decisive = int(np.searchsorted(cuts, abs(self._decisive or 0.0)))
        todo = _parted(0, len(cuts) - 1, decisive)
        while todo:
            # nearer to what holds first
            first, stop = todo.pop(min(range(len(todo)), key=lambda i: _apart(cuts, todo[i], held)))
            low, high = float(cuts[first]), float(cuts[stop])
            last = float(np.nextafter(high, 0.0))
            alone, said = stop - first == 1, None
            if alone and left and (low == last or not seen.exactly):
                said = self._again.judged(self._rule, {param: like(usual, low)})
            elif left and stop - first < len(cuts) - 1:  # of all values it is known already
                left -= 1
                said = self._said({param: self._range(param, low, last)})
            if alone and said is None and low <= held < high:
                return [Piece(0.0, np.inf, None)]  # no other value will tell more
            if said is not None or alone or not left:
                out.append(Piece(low, high, *(said or (None,))))
            else:
                todo += _parted(first, stop, (first + stop) // 2)
        return _joined(sorted(out))

    def _range(self, param: str, low: float, high: float) -> Range:
        reach = max(FURTHER * max(amount(self._usual[param]), 0.0), self._further)
        return Range(low, high, reach, self._seen[param])

    def _said(self, values: Mapping[str, Range]) -> Said | None:
        """The verdict, where it is the same on all values of some ranges; else None."""
        params: dict[str, Any] = {**self._usual, **values}
        return _verdict(self._evaluator.under(params), self._rule, self._again.players(self._rule))


def _verdict(
    evaluator: Evaluator, rule: ast.Rule, players: Mapping[str, Sequence[str]]
) -> Said | None:
    """The verdict under values of which some are ranges; None where it is not the same on all of them."""
    evaluator.players = players
    envs = [*combinations(rule, players)]
    try:
        given = [applies(evaluator, rule, env) for env in envs]
        found = [judge_instances(evaluator, rule, env) or [] for env in envs]
    except Undecided:
        return None
    instances = [one for some in found for one in some]
    if envs and not any(each is not False for each in given):
        return "not_applicable", False
    if any(one.violated for one in instances):
        return "violation", True
    scopes = [one.scope for one in instances]
    if any(one.lower < 0 for one in instances) or (envs and True not in given):
        return None
    if any(scope.sure is not None or scope.first == scope.stop for scope in scopes):
        return None  # there may be nothing to judge
    surely = any(some for some, each in zip(found, given, strict=True) if each)
    return ("pass", surely) if surely == bool(scopes) else None


def _cuts(seen: Seen) -> F64:
    """Where a comparison may change, rising from 0 to infinity: each value, and the float after it."""
    values = np.unique(np.concatenate([np.zeros(1), *seen.values]))
    values = values[(values >= 0) & np.isfinite(values)]
    return np.unique(np.concatenate([values, np.nextafter(values, np.inf), [np.inf]]))


def _parted(first: int, stop: int, middle: int) -> list[tuple[int, int]]:
    """The cuts from ``first`` to ``stop``, parted in two at one between them, if it is."""
    if not first < middle < stop:
        return [(first, stop)]
    return [(first, middle), (middle, stop)]


def _apart(cuts: F64, span: tuple[int, int], held: float) -> float:
    """How far the value that holds is from a range."""
    low, high = cuts[span[0]], cuts[span[1]]
    return float(max(low - held, held - high, 0.0))


def _joined(pieces: Sequence[Piece]) -> list[Piece]:
    """Neighbours that say the same, put together."""
    out = list[Piece]()
    for piece in pieces:
        if out and out[-1][2:] == piece[2:]:
            out[-1] = out[-1]._replace(high=piece.high)
        else:
            out.append(piece)
    return out
