"""Durations that lengthen or shift the stretches in which a rule is judged.

As a duration grows, both ends of every stretch only ever move one way. Between two durations it is
therefore judged at least the frames that both stretches share, and at most those of either. Where all
obligations come to the same in the fewest and the most of these frames, the verdict does not change;
else the durations between are halved.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import parameters_read
from safestage_eval.states.band import Band
from safestage_eval.states.scope import Scope, mask_of
from safestage_eval.verdicts.players import combinations
from safestage_eval.verdicts.stretches import applies, stretches
from safestage_eval.verdicts.values import Env
from safestage_eval.verdicts.verdict import VerdictName

from .flip_bands import FlipBands
from .flip_case import Case
from .flip_clauses import clause_keys
from .flip_lasting import Undecided

Plain = tuple[float, float, "VerdictName | None", bool]

CUTS = 4000
"""Times that the durations of one case are halved."""


class Judged(NamedTuple):
    """A combination of bodies that a rule is about, and its obligations at all frames."""

    env: Env
    bands: tuple[Band, ...]


def duration_pieces(case: Case) -> list[Plain] | None:
    """The verdicts on all durations from 0 on, where a rule's scope has the parameter for one.

    None where it does not enter as a duration of a stretch. Raises Undecided where it enters in
    other ways as well.
    """
    rule, rules = case.rule, case.base.rules
    if rule.during is None or not _lengths(rule.during, case):
        return None
    others = (rule.given, rule.for_, rule.at, rule.until, *(c.what for c in rule.clauses))
    if any(case.param in parameters_read(rules, part) for part in others if part is not None):
        raise Undecided("it is a duration and more")
    if not case.base.clock.uniform:
        raise Undecided("the clock is not uniform")
    return _Durations(case).pieces()


def _lengths(span: ast.Span, case: Case) -> bool:
    """The parameter is the length of a part of a span; raises Undecided where it is more than that."""
    rules, param = case.base.rules, case.param
    if isinstance(span, ast.PhaseSpan):
        phase = rules.phases[span.call.name]
        moves = _lengths(phase.span, case)
        if phase.fallback is None or param not in parameters_read(rules, phase.fallback):
            return moves
        if not _settled(phase, case):
            raise Undecided("another stretch may take its place")
        return moves
    if isinstance(span, ast.Part | ast.Around):
        own = isinstance(span.duration, ast.Parameter) and span.duration.name == param
        inner = _lengths(span.of, case) if isinstance(span, ast.Part) else False
        if own and inner:
            raise Undecided("it moves both ends")
        return own or inner
    if isinstance(span, ast.While):
        moves = _lengths(span.of, case)
        if moves and param in parameters_read(rules, span.call):
            raise Undecided("it is a duration and more")
        return moves
    return False


def _settled(phase: ast.PhaseDef, case: Case) -> bool:
    """A phase has a stretch of its own, whatever the parameter: success came."""
    events = [
        node
        for node in _parts(phase.span, case)
        if isinstance(node, ast.Around) and node.event.kind == "success"
    ]
    return bool(events) and case.base.success is not None and case.base.success_known


def _parts(span: ast.Span, case: Case) -> list[ast.Span]:
    if isinstance(span, ast.PhaseSpan):
        return _parts(case.base.rules.phases[span.call.name].span, case)
    if isinstance(span, ast.Part):
        return [span, *_parts(span.of, case)]
    return [span]


class _Durations:
    def __init__(self, case: Case) -> None:
        self._case, self._rule = case, case.rule
        base = self._base = case.base
        base.players = case.players
        self._scopes: dict[float, list[list[Scope]]] = {}
        self._left = CUTS
        self._about = [
            env for env in combinations(case.rule, case.players)
            if applies(base, case.rule, env) is not False
        ]  # fmt: skip
        if any(applies(base, case.rule, env) is None for env in self._about):
            raise Undecided("whether it applies is not known")
        # beyond the recording nothing changes any more
        self._end = 2 * (float(base.episode.t[-1]) + base.clock.dt) + 1
        if isinstance(case.usual, ast.Duration) and case.usual.frames:
            self._end = 2.0 * base.frames + 1
        self._flips = FlipBands(base, base, case.param, 0.0, "up", case.counts, 0.0)
        everything = [*self._at(0.0), *self._at(self._end)]
        lows = [min((s.first for s in stretch), default=0) for stretch in everything]
        highs = [max((s.stop for s in stretch), default=0) for stretch in everything]
        wanted = mask_of([Scope(min(lows, default=0), max(highs, default=0))], base.frames)
        self._judged = [
            Judged(
                env,
                tuple(
                    self._flips.alternative(c.what, env, c.kind, wanted) for c in case.rule.clauses
                ),
            )
            for env in self._about
        ]

    def pieces(self) -> list[Plain]:
        """The verdicts on all durations; a piece ends where the next float is not alike."""
        changes = self._changes(0.0, self._end)
        out: list[Plain] = []
        for low, high in zip([0.0, *changes], [*changes, np.inf], strict=True):
            out.append((low, high, *self._case.judged(low)))
        return out

    def _at(self, number: float) -> list[list[Scope]]:
        """The stretches of each combination of bodies under a duration."""
        if number not in self._scopes:
            at = self._case.at(number)
            self._scopes[number] = [
                [scope for scope, _ in stretches(at, self._rule, env)] for env in self._about
            ]
        return self._scopes[number]

    def _changes(self, low: float, high: float) -> list[float]:
        """The durations in (low, high] at which the verdict may differ from that just below."""
        out: list[float] = []
        todo = [(low, high)]
        while todo:
            a, b = todo.pop()
            self._left -= 1
            if self._left < 0:
                raise Undecided("it changes too often")
            if self._same(self._at(a), self._at(b)):
                continue
            middle = (a + b) / 2
            if not a < middle < b:  # neighbouring floats
                out.append(b)
                continue
            todo += [(middle, b), (a, middle)]
        return out

    def _same(self, some: list[list[Scope]], others: list[list[Scope]]) -> bool:
        """The verdict is the same under two durations and all between."""
        for judged, first, second in zip(self._judged, some, others, strict=True):
            if len(first) != len(second):
                return False
            for one, other in zip(first, second, strict=True):
                if not self._alike(judged, one, other):
                    return False
        return True

    def _alike(self, judged: Judged, one: Scope, other: Scope) -> bool:
        if _equal(one, other):
            return True
        if one.sure is not None or other.sure is not None or one.cut != other.cut:
            return False
        if (one.first == one.stop) or (other.first == other.stop):
            return False
        core = max(one.first, other.first), min(one.stop, other.stop)
        union = min(one.first, other.first), max(one.stop, other.stop)
        if core[0] >= core[1]:
            core = (one.first, one.first)
        signs = [
            [
                tuple(
                    key >= 0
                    for key in clause_keys(
                        self._flips, self._rule, clause.kind, band.at(*frames), one
                    )
                )
                for clause, band in zip(self._rule.clauses, judged.bands, strict=True)
            ]
            for frames in (core, union)
        ]
        return signs[0] == signs[1]


def _equal(one: Scope, other: Scope) -> bool:
    if one[:3] != other[:3] or (one.sure is None) != (other.sure is None):
        return False
    return one.sure is None or bool((one.certain == other.certain).all())
