"""The verdict of a rule on all values of a parameter: proved for whole ranges, judged where it changes.

The evaluator takes uncertain measurements, and an uncertain limit is no different: where a comparison
comes out alike for every value of a range, its truth is certain, else it is open. A verdict that is
decided all the same holds for the whole range; otherwise the range is halved (interval analysis: Moore,
"Interval Analysis", 1966). A limit can only change a verdict at a value that was measured, so ranges are
cut there alone, and between two neighbouring cuts any one value speaks for all.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from safestage_eval.evidence import intervals
from safestage_eval.evidence.intervals import F64, Bool, Interval
from safestage_eval.geometry.gjk import PROMISED
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import ClauseKind
from safestage_eval.rules.digest import parameters_read
from safestage_eval.rules.syntax import amount
from safestage_eval.verdicts.evaluate import Evaluated, Evaluator, Node
from safestage_eval.verdicts.language import Asked, Env
from safestage_eval.verdicts.obligations import judge_instances
from safestage_eval.verdicts.players import combinations
from safestage_eval.verdicts.scopes import applies
from safestage_eval.verdicts.since import reference_of
from safestage_eval.verdicts.verdict import VerdictName

from .judge_again import Again
from .swept_values import like

ROUNDING = 2 * PROMISED
"""M, by which a distance that is measured anew may differ."""

BEYOND = 1e3
"""M; no distance that is measured is as large."""

FURTHER = 2.0
"""Factor on the limit that holds, up to which distances are compared with limits."""

MOST = 40
"""Ranges that are tried for one rule and parameter."""


class Undecided(Exception):  # noqa: N818 - it is no error
    """Raised where the dependence of a verdict on a parameter is not followed: judge it again."""


class Range(NamedTuple):
    """All values of a parameter from ``low`` to ``high``, both included; not negative."""

    low: float
    high: float


EVERY = Range(0.0, np.inf)

ANEW = Range(0.0, float(np.finfo(np.float64).max))
"""The same, asked for once per rule and parameter: nothing that was found earlier answers it."""

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

    def holds(self, value: ast.Setting, usual: ast.Setting) -> bool:
        """The value is one of them; ``usual``: of the kind that they are of."""
        match value, usual:
            case ast.Duration(), ast.Duration() if value.frames != usual.frames or value.least > 1:
                return False
        return self.low <= amount(value) < self.high


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
    origin = again.evaluator(rule)
    if not all(again.players(rule).values()):  # whatever the values
        return {param: [Piece(0.0, np.inf, again.usual(rule).verdict)] for param in params}
    out = {param: [Piece(0.0, np.inf, None)] for param in params}
    if isinstance(rule, ast.Rule) and not origin.clock.coarse.any():
        follow = [param for param in params if not again.moves_success(param)]
        settled = _settled(again, rule, follow) if follow else {}
        out |= {param: [Piece(0.0, np.inf, *said)] for param, said in settled.items()}
        for param in follow:
            if param not in settled:
                out[param] = _halved(again, rule, param, further)
    return out


def _settled(again: Again, rule: ast.Rule, params: Sequence[str]) -> dict[str, Said]:
    """The parameters on which the verdict does not hang at all, found by halving their list."""
    said = ranged(again, rule, dict.fromkeys(params, EVERY))
    if said is not None:
        return dict.fromkeys(params, said)
    if len(params) == 1:
        return {}
    middle = len(params) // 2
    return {**_settled(again, rule, params[:middle]), **_settled(again, rule, params[middle:])}


def _halved(again: Again, rule: ast.Rule, param: str, further: float) -> list[Piece]:
    """The verdict on all values of a parameter, from ranges that are halved until they decide it."""
    usual = again.binding.params(rule)[param]
    held = max(amount(usual), 0.0)
    reach = max(FURTHER * held, further) * (1 + 1e-6) + 1e-6
    compared = Compared()
    ranged(again, rule, {param: ANEW}, reach, compared)
    cuts, left, out = compared.cuts(), MOST, list[Piece]()
    todo = [(0, len(cuts) - 1)]
    while todo:
        first, stop = todo.pop()
        low, high = float(cuts[first]), float(cuts[stop])
        last, said = float(np.nextafter(high, 0.0)), None
        alone = stop - first == 1
        if alone and (low == last or compared.alone) and left:
            said = again.judged(rule, {param: like(usual, low)})
        elif left and stop - first < len(cuts) - 1:  # of all values it is known already
            left -= 1
            said = ranged(again, rule, {param: Range(low, last)}, reach)
        if alone and said is None and low <= held < high:
            return [Piece(0.0, np.inf, None)]  # no other value will tell more
        if said is not None or alone or not left:
            out.append(Piece(low, high, *(said or (None,))))
            continue
        middle = (first + stop) // 2
        halves = [(first, middle), (middle, stop)]
        todo += halves[::-1] if held < cuts[middle] else halves  # nearer to what holds first
    return _joined(sorted(out))


def _joined(pieces: Sequence[Piece]) -> list[Piece]:
    """Neighbours that say the same, put together."""
    out = list[Piece]()
    for piece in pieces:
        if out and out[-1][2:] == piece[2:]:
            out[-1] = out[-1]._replace(high=piece.high)
        else:
            out.append(piece)
    return out


def ranged(
    again: Again,
    rule: ast.Rule,
    values: Mapping[str, Range],
    reach: float = 0.0,
    compared: Compared | None = None,
) -> Said | None:
    """The verdict of a rule, where it is the same on all values of some ranges; else None.

    Args:
        again: the episode.
        rule: with a player for each role.
        values: parameter → range.
        reach: m, up to where distances are wanted.
        compared: to note what the parameter is compared with; then nothing is taken from earlier.
    """
    evaluator = Ranged(again.evaluator(rule), values, reach, compared)
    evaluator.players = again.players(rule)
    envs = [*combinations(rule, evaluator.players)]
    try:
        given = [applies(evaluator, rule, env) for env in envs]
        found = [judge_instances(evaluator, rule, env) or [] for env in envs]
    except Undecided:
        evaluator.compared.alone = False
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


class Compared:
    """What a parameter is compared with.

    Attributes:
        alone: as a plain limit, and with nothing else: between two cuts one value speaks for all.
    """

    def __init__(self) -> None:
        """Nothing yet."""
        self.alone = True
        self._values: list[F64] = []

    def note(self, series: Interval, limit: ast.Parameter) -> None:
        """Add the values (T,) of a signal that a parameter limits."""
        for end in (series.lower, series.upper):
            self._values.append(-end if limit.negative else end)

    def cuts(self) -> F64:
        """Where a comparison may change, rising from 0 to infinity: each value, and the float after it."""
        values = np.unique(np.concatenate([np.zeros(1), *self._values]))
        values = values[(values >= 0) & np.isfinite(values)]
        return np.unique(np.concatenate([values, np.nextafter(values, np.inf), [np.inf]]))


class Ranged(Evaluator):
    """The evaluator with ranges in the place of some parameters' values.

    A limit that is one of them makes a truth certain where it is for the whole range. Whoever asks for its
    value for anything else (an option of a measurement, how long a state has to last) is told nothing:
    what it was asked for is unknown.
    """

    def __init__(
        self,
        origin: Evaluator,
        values: Mapping[str, Range],
        reach: float,
        compared: Compared | None,
    ) -> None:
        """Prepare; nothing is computed yet. Arguments as ``ranged``."""
        known: Any = origin._memo  # noqa: SLF001 - of an evaluator like this one
        memo: Any = known if compared is None else ChainMap({}, known)
        params: dict[str, Any] = {**origin.params, **values}
        super().__init__(
            origin.relations, origin.rules, params, origin.success,
            success_known=origin.success_known, memo=memo,
        )  # fmt: skip
        self.compared = Compared() if compared is None else compared
        self._values, self._usual, self._reach = values, origin.params, reach

    def reads(self, node: object) -> bool:
        """A part of the rules depends on the parameters."""
        return not self._values.keys().isdisjoint(parameters_read(self.rules, node))

    # ---- in the place of the evaluator's own

    def setting(self, name: str) -> ast.Setting:
        """The value of a parameter that is no range."""
        if name in self._values:
            self.compared.alone = False
            raise Undecided
        return super().setting(name)

    def limit(self, value: ast.Value, env: Env) -> float:
        """A limit's value; of a range the value that holds, as far as signals are measured for it."""
        if isinstance(value, ast.Parameter) and value.name in self._values:
            usual = amount(self._usual[value.name])
            return -usual if value.negative else usual
        return self.number(value, env)

    def evaluate(
        self, node: Node, env: Env, kind: ClauseKind | None = None, frames: Bool | None = None
    ) -> Evaluated:
        """A part of a rule over the episode; unknown where the range changes what it looks at."""
        try:
            if isinstance(node, ast.SignalAtom) and node.since is not None and self.reads(node):
                self._since_known(node.since, env)
            return super().evaluate(node, env, kind, frames)
        except Undecided:
            no = np.zeros(self.frames, np.bool_)
            return Evaluated(node, env, _open(no, ~no))

    def _since_known(self, event: ast.Event, env: Env) -> None:
        """Raise Undecided where the range changes when an event comes, or that is not known anyway."""
        if self.reads(event) or reference_of(self, event, env)[1] is not None:
            self.compared.alone = False
            raise Undecided

    def must_not(
        self,
        call: ast.Call,
        env: Env,
        only: ClauseKind | None,
        kind: ClauseKind | None,
        frames: Bool | None = None,
    ) -> Evaluated:
        """A state, as an obligation that breaks where it holds has to see it."""
        state = self.rules.states.get(call.name)
        if state is not None and self.reads(state.for_):
            return self.state(call, env, frames)
        return super().must_not(call, env, only, kind, frames)

    def _needed(self, state: ast.StateDef, frames: Bool) -> Bool | None:
        return None if self.reads((state.for_, state.gap)) else super()._needed(state, frames)

    def _persistent(self, state: ast.StateDef, raw: Interval) -> Interval:
        try:
            return super()._persistent(state, raw)
        except Undecided:
            sure, possible = np.zeros(self.frames, np.bool_), raw.upper >= 0
            if self.reads(state.gap):
                return _open(sure, np.full(self.frames, possible.any()))
            return _open(sure, super()._persistent(replace(state, for_=None), raw).upper >= 0)

    def measured_series(
        self, asked: Asked, atom: ast.SignalAtom, env: Env, frames: Bool | None
    ) -> Interval:
        """(T,) the signal of an atom; a distance as far as any value of the range needs it."""
        if not self.reads(atom):
            return super().measured_series(asked, atom, env, frames)
        if not self.signal(asked.name).capped:
            return super().measured_series(asked, atom, env, frames)
        self.compared.alone = False
        others = [
            number
            for number, limit in zip(asked.limits, atom.limits, strict=True)
            if not self.reads(limit)
        ]
        # a limit beyond all distances: bounds stay as wide as they may be
        series = self.relations.signal(
            asked.name, asked.bodies, None, self._reach, None, asked.options, (BEYOND, *others)
        )
        # measured for another limit, a distance may come out as another number within its bounds
        return replace(series, lower=series.lower - ROUNDING, upper=series.upper + ROUNDING)

    def margins(self, series: Interval, atom: ast.SignalAtom, asked: Asked) -> Interval:
        """(T,) of what an atom asks for: ±∞, or both where the range decides."""
        each = [
            self._holds(series, limit, number)
            for limit, number in zip(atom.limits, asked.limits, strict=True)
        ]
        return intervals.both(each, len(series))

    def _holds(self, series: Interval, limit: ast.Limit, number: float) -> Interval:
        least = most = number
        if isinstance(limit.value, ast.Parameter) and limit.value.name in self._values:
            self.compared.note(series, limit.value)
            least, most = self._values[limit.value.name]
            if limit.value.negative:
                least, most = -most, -least
        test, up = _TESTS[limit.op], limit.op[0] == ">"
        if not up:
            least, most = most, least
        first, second = (series.lower, series.upper) if up else (series.upper, series.lower)
        margin = _open(test(first, most), test(second, least))
        return margin if series.known.all() else intervals.hide(margin, ~series.known)


def _open(sure: Bool, possible: Bool) -> Interval:
    """A truth that ranges: where it is open, its ends are ±1, for ±∞ is what was not recorded."""
    lower = np.where(sure, np.inf, np.where(possible, -1.0, -np.inf))
    if (sure == possible).all():
        return Interval(lower, lower)
    return Interval(lower, np.where(sure, np.inf, np.where(possible, 1.0, -np.inf)))


_TESTS = {">=": np.greater_equal, ">": np.greater, "<=": np.less_equal, "<": np.less}
