"""``[[cost]]``: charges that are summed, and whether the sum stayed within its budget."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from safestage_eval.episode.runs import runs
from safestage_eval.evidence.intervals import F64, Bool
from safestage_eval.rules import syntax as ast

from .evaluate import Evaluator
from .events import Scope, mask_of
from .explain import Finding, measured, seconds, sentence
from .language import Env
from .players import combinations, mentions, nodes
from .scopes import applies, stretches
from .verdict import CostTotal, Verdict
from .witness import Witness

ROUNDING = 1e-9
"""Relative: sums of many small charges may be off by so much without exceeding a budget."""


@dataclass
class _Bill:
    """Charges per frame, certain and possible, and who caused them.

    Attributes:
        least, most: (T,) what was certainly, and at most, charged at each frame.
        unseen: more may have been charged where the trace does not tell.
        end: frame behind the last one that was charged for.
        entries: charge in words → its least and most sum.
        worst: the bodies that caused most, and how much that was.
        judged, charged: combinations of bodies that were looked at, and that caused something.
    """

    least: F64
    most: F64
    unseen: bool = False
    end: int = 0
    entries: dict[str, tuple[float, float]] = field(default_factory=dict)
    worst: tuple[dict[str, str], float] = field(default_factory=lambda: ({}, -1.0))
    judged: int = 0
    charged: int = 0

    def add(self, words: str, env: dict[str, str], least: F64, most: F64) -> None:
        self.least += least
        self.most += most
        low, high = float(least.sum()), float(most.sum())
        before = self.entries.get(words, (0.0, 0.0))
        self.entries[words] = (before[0] + low, before[1] + high)
        self.judged += 1
        self.charged += high > 0
        if low > self.worst[1]:
            self.worst = (env, low)


def judge_cost(
    evaluator: Evaluator, cost: ast.Cost, players: Mapping[str, Sequence[str]], blank: Verdict
) -> tuple[CostTotal, Verdict | None]:
    """The sum of a cost, and the verdict if it has a budget.

    Every charge is summed over the frames of the scope and over the combinations of bodies that
    it, or the scope, names. What is not known makes the sum an interval: above the budget at its
    lower end is a violation, within it at its upper end a pass.

    Args:
        evaluator: of the episode, under the cost's parameters.
        cost: to be summed.
        players: role → the bodies that play it, none of them empty unless ``blank`` says so.
        blank: the verdict's fixed fields.
    """
    evaluator.players, evaluator.notes = players, {}
    limit = None if cost.budget is None else evaluator.number(cost.budget, {})
    if blank.vacuity:
        return _total(blank, None, limit), None if limit is None else blank
    bill = _bill(evaluator, cost, players)
    if bill is None:
        why = "its condition does not hold in the first frames"
        blank = replace(blank, vacuity="not_given", notes=(*evaluator.notes, why))
        return _total(blank, None, limit), None if limit is None else blank
    total = _total(blank, bill, limit, tuple(evaluator.notes))
    return total, None if limit is None else _verdict(evaluator, cost, bill, limit, blank)


def _total(
    blank: Verdict, bill: _Bill | None, limit: float | None, notes: tuple[str, ...] = ()
) -> CostTotal:
    start = CostTotal(blank.rule, blank.title, blank.stage, blank.assigned, limit)
    if bill is None:
        return replace(
            start, notes=blank.notes, sources=blank.sources, rule_digest=blank.rule_digest
        )
    most = float(bill.most.sum())
    return replace(
        start,
        value=float(bill.least.sum()),
        most=None if bill.unseen or not np.isfinite(most) else most,
        charges=tuple((words, low) for words, (low, _) in bill.entries.items()),
        bodies=tuple(dict.fromkeys(bill.worst[0].values())),
        instances=bill.judged,
        notes=notes,
        sources=blank.sources,
        rule_digest=blank.rule_digest,
    )


def _verdict(
    evaluator: Evaluator, cost: ast.Cost, bill: _Bill, limit: float, blank: Verdict
) -> Verdict:
    episode = evaluator.episode
    threshold = limit + abs(limit) * ROUNDING + ROUNDING
    running = np.cumsum(bill.least)
    value = float(running[-1]) if len(running) else 0.0
    most = np.inf if bill.unseen else float(bill.most.sum())
    violated, undecided = value > threshold, value <= threshold < most
    over = int(np.argmax(running > threshold))
    charged = np.flatnonzero(bill.least)
    worst = int(charged[-1]) if len(charged) else 0
    witness = Witness(
        "cost", (), worst, value, limit, limit - value, "", at_least=value < most or undecided
    )
    verdict = replace(
        blank,
        verdict="violation" if violated else "inconclusive" if undecided else "pass",
        signal="cost",
        value=value,
        limit=limit,
        dimension="",
        margin=limit - value,
        margin_normalised=(limit - (value if violated or not undecided else most)) / (limit or 1.0),
        bodies=tuple(dict.fromkeys(bill.worst[0].values())),
        instances=bill.judged,
        violated_instances=bill.charged if violated else 0,
        breaches=int(violated),
        worst_time=float(episode.t[worst]),
        notes=(*evaluator.notes, *_charges(bill)),
    )
    if verdict.margin_normalised is not None and not np.isfinite(verdict.margin_normalised):
        verdict = replace(verdict, margin_normalised=None)
    if violated:
        begin, end = float(episode.t[over]), evaluator.clock.end_of(max(bill.end, over + 1))
        verdict = replace(verdict, time=begin, intervals=((begin, end),), exposure_time=end - begin)
    if undecided:
        bound = "no bound" if not np.isfinite(most) else f"{most:.3g} at most"
        why = f"the cost is {value:.3g} at least and {bound}; the budget is {limit:.3g}"
        return replace(verdict, explanation=f"Cannot be decided: {why}.")
    if not (violated and cost.explain):
        return replace(verdict, explanation=_spent(witness, verdict.time))
    finding = Finding(verdict.verdict, verdict.time, verdict.worst_time, verdict.margin)
    said = sentence(evaluator, cost, bill.worst[0], witness, finding)
    return replace(verdict, explanation=said)


def _spent(witness: Witness, exceeded: float | None) -> str:
    """The sentence of a cost; ``exceeded``: s, when it came to exceed its budget, None if never."""
    value, budget = measured(witness.value, witness), measured(witness.limit, witness)
    if exceeded is None:
        return f"The cost came to {value}; the budget is {budget}."
    return f"The cost came to {value} and exceeded its budget of {budget} at {seconds(exceeded)}."


def _charges(bill: _Bill) -> list[str]:
    """One note per charge that was made."""
    return [f"charged {low:.3g} for {words}" for words, (low, _) in bill.entries.items() if low > 0]


def _bill(
    evaluator: Evaluator, cost: ast.Cost, players: Mapping[str, Sequence[str]]
) -> _Bill | None:
    """All charges; None where ``given`` holds for no combination of bodies."""
    frames = evaluator.frames
    bill = _Bill(np.zeros(frames), np.zeros(frames))
    around = (cost.given, cost.during, cost.at, cost.until)
    for charge in cost.charge:
        words = _words(charge)
        named = [
            name
            for name, _ in cost.roles
            if mentions(charge, name) or any(mentions(part, name) for part in around)
        ]
        for env in combinations(cost, players, named):
            given = applies(evaluator, cost, env)
            if given is False:
                continue
            scopes = [scope for scope, _ in stretches(evaluator, cost, env)]
            once = charge.of is not None and charge.per == "start"
            asked = [_first(scope) for scope in scopes] if once else scopes
            sure, may = _masks(asked, frames, sure=given is True)
            bill.end = max([bill.end, *(s.stop for s in scopes)])
            bill.unseen |= any(s.cut for s in scopes)
            hidden = evaluator.clock.unseen
            bill.unseen |= hidden is not None and any(
                hidden[s.first : s.stop].any() for s in scopes
            )
            bill.add(words, env, *_amounts(evaluator, charge, env, sure, may))
    return bill if bill.judged else None


def _first(scope: Scope) -> Scope:
    """The first frame of a stretch."""
    stop = min(scope.first + 1, scope.stop)
    return Scope(scope.first, stop, scope.cut, scope.certain[: stop - scope.first])


def _masks(scopes: Sequence[Scope], frames: int, *, sure: bool) -> tuple[Bool, Bool]:
    """(T,) the frames that are certainly, and possibly, charged for."""
    surely = np.zeros(frames, np.bool_)
    for scope in scopes:
        surely[scope.first : scope.stop] |= scope.certain
    return surely & sure, mask_of(scopes, frames)


def _amounts(
    evaluator: Evaluator, charge: ast.Charge, env: Env, sure: Bool, may: Bool
) -> tuple[F64, F64]:
    """(T,) what is certainly, and at most, charged at each frame."""
    if charge.of is not None:
        bound = charge.below or charge.above or ast.Quantity(0.0, "")
        limits = [ast.Limit(">", bound)]
        if charge.below is not None:  # of a distance the depth counts as well
            limits.append(ast.Limit(">", ast.Quantity(0.0, "")))
        atom = ast.SignalAtom(charge.of, tuple(limits))
        series, limit = evaluator.series(atom, env, may), evaluator.number(bound, env)
        low, high = series.lower, series.upper
        if charge.below is not None:
            low, high = limit - high, limit - low
        else:
            low, high = low - limit, high - limit
        low, high = np.maximum(low, 0.0), np.maximum(high, 0.0)
        least, most = np.where(sure, low, 0.0), np.where(may, high, 0.0)
    else:
        assert charge.when is not None
        # whether a stretch starts in the scope hangs on the frame before it
        near = may | np.append(may[1:], False)
        band = evaluator.evaluate(charge.when, env, None, near).margin
        true, possible = band.true, band.possible
        if charge.per == "start":
            least, most = _starts(true, possible, sure, may)
        else:
            least, most = (true & sure).astype(float), (possible & may).astype(float)
    size: float | F64 = charge.add
    clock = evaluator.clock
    spacing: float | F64 = clock.dt if clock.uniform else clock.spacing
    if charge.per == "second":
        size = size * spacing
    elif charge.per == "step":
        step = evaluator.episode.header.control_dt
        size = size * (spacing / step) if step else size
    return least * size, most * size


def _starts(true: Bool, possible: Bool, sure: Bool, may: Bool) -> tuple[F64, F64]:
    """(T,) 1 where a stretch of truth starts: the fewest and the most that there can be.

    A possible stretch that holds a certain frame starts once at least, at that frame or before. Of
    neighbouring frames that may be starts every other one can be.
    """
    least, most = np.zeros(len(true)), np.zeros(len(true))
    for first, stop in runs(possible):
        certain = np.flatnonzero(true[first:stop])
        if len(certain) and sure[first : first + certain[0] + 1].all():
            least[first + certain[0]] = 1.0
    before = np.concatenate([[False], true[:-1]])
    for first, stop in runs(possible & ~before & may):
        most[first:stop:2] = 1.0
    return least, most


def _words(charge: ast.Charge) -> str:
    """``contact(robot, vase), per start``."""
    if charge.of is not None:
        side = "above" if charge.below is None else "below"
        bound = charge.above if charge.below is None else charge.below
        said = f" {side} {bound.text}" if isinstance(bound, ast.Quantity) and bound.text else ""
        return f"{charge.of}{said}, per {charge.per}"
    if isinstance(charge.when, ast.Event):
        return f"{charge.when.text or charge.when.kind}, per {charge.per}"
    calls = dict.fromkeys(str(n) for n in nodes(charge.when) if isinstance(n, ast.Call))
    return f"{', '.join(calls)}, per {charge.per}"
