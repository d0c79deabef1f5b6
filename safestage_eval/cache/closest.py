"""The closest call of a condition that a rule requires, told from a few of its numbers.

Of each series and state of the condition these are, in each scope: the least and greatest value with
the first frame that has it, the one next to it among earlier frames, and its values at the frames
found so. From them follow the margin under any limit, the frame that it rests on, and which entry of
the condition decided there, as from all frames.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from safestage_eval.evidence.declare import is_costly
from safestage_eval.evidence.measure import how, loose
from safestage_eval.evidence.series import Series
from safestage_eval.geometry.clearance import Clearance
from safestage_eval.rules import syntax as ast
from safestage_eval.signals import SIGNALS
from safestage_eval.states.band import F64, TINY, Bool
from safestage_eval.states.scope import Scope
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.instance import Instance, applies, negated_margin, stretches
from safestage_eval.verdicts.values import Env
from safestage_eval.verdicts.witness import Search, Witness, or_tied

from .entry import Value
from .names import partial_name, series_name, state_name

if TYPE_CHECKING:
    from .remembered import RememberedRelations

FEW = 64
"""Scopes of a rule, and stretches of values with slack of a series; of more, nothing is kept."""

Seen = Mapping[str, tuple[Series, float]]
"""The series that a rule compares with limits, each with its cap, by name."""

LEAST, GREATEST = "least", "greatest"


class Row(NamedTuple):
    """A series or a state, the sides from which limits come, and where it is known; None: everywhere."""

    name: str
    ends: tuple[F64, ...]
    sides: set[str]
    about: Value
    done: Bool | None


def place(env: Env, first: int, stop: int) -> str:
    """Name of what is kept of some bodies in a scope."""
    return f"{tuple(env.items())} {first} {stop}"


def closest_of(evaluator: Evaluator, rule: ast.Rule, instances: Sequence[Env], seen: Seen) -> Value:
    """What is kept of a rule that was judged just now; nothing where it requires no condition."""
    out: Value = {}
    if not isinstance(rule.require, ast.Condition):
        return out
    for env in instances:
        if applies(evaluator, rule, env) is False:
            continue
        for scope, _ in stretches(evaluator, rule, env):
            if scope.sure is not None or scope.first >= scope.stop:
                continue
            if len(out) == FEW:
                return {}
            inside = slice(scope.first, scope.stop)
            rows = [
                row
                for atom in rule.require.atoms
                for row in _rows(evaluator, atom, env, seen)
                if not any(np.isnan(end[inside]).any() for end in row.ends)
                and (row.done is None or row.done[inside].all())
            ]
            out[place(env, scope.first, scope.stop)] = _kept(rows, scope)
    return out


def _kept(rows: Sequence[Row], scope: Scope) -> Value:
    """The numbers of a scope."""
    told: dict[str, Value] = {}
    inside = {row.name: [end[scope.first : scope.stop] for end in row.ends] for row in rows}
    for row in rows:
        found = {side: [_extreme(end, side) for end in inside[row.name]] for side in row.sides}
        told[row.name] = row.about | found
    frames = sorted({at for row in rows for s in row.sides for _, at, _ in told[row.name][s]})
    for name, ends in inside.items():
        told[name]["at"] = [end[frames].tolist() for end in ends]
    return {"frames": frames, "rows": told}


def _extreme(values: F64, side: str) -> tuple[float, int, float | None]:
    """The least or greatest value, the first frame that has it, and the next to it before that."""
    least = side == LEAST
    at = int(values.argmin() if least else values.argmax())
    before = values[:at]
    next_ = None if not at else float(before.min() if least else before.max())
    return float(values[at]), at, next_


def _rows(evaluator: Evaluator, atom: ast.Atom, env: Env, seen: Seen) -> Iterator[Row]:
    """Whatever an entry of the condition may compare, under any limits."""
    if isinstance(atom, ast.StateAtom):
        name = _state(evaluator, atom, env)
        told = evaluator.found(atom.call.name, _bodies(atom, env))
        if name is not None and told is not None and not told[1]:
            yield _row(name, *told[0], {LEAST if atom.want else GREATEST})
    elif isinstance(atom, ast.SignalAtom) and atom.since is None:
        sides = {_side(limit) for limit in atom.limits}
        signal, bodies, options, limits, reach = evaluator.asked(atom, env)
        if is_costly(signal):
            known = cast("RememberedRelations", evaluator.relations).partial(
                signal, bodies, options
            )
            if known is not None and not known.notes:
                about: Value = {"dimension": SIGNALS[signal].dimension}
                name = partial_name(signal, bodies, options)
                yield _row(name, known.lower, known.upper, sides, about, known.done)
            return
        cap, deep, slack = how(signal, reach, limits)
        for taken in {slack, 0.0}:
            name = series_name(signal, bodies, "", cap, deep, taken, options)
            series, _ = seen.get(name, (None, 0.0))
            if series is not None and not series.notes:
                open_ = _together(loose(series, cap)) if taken else [[], []]
                if len(open_[0]) <= FEW:
                    about = {"dimension": series.dimension, "loose": open_}
                    yield _row(name, series.lower, series.upper, sides, about)


def _row(
    name: str, lower: F64, upper: F64, sides: set[str], about: Value | None = None,
    done: Bool | None = None,
) -> Row:  # fmt: skip
    return Row(name, (lower,) if upper is lower else (lower, upper), sides, about or {}, done)


def _together(taken: Clearance) -> list[list[float]]:
    """Lower and upper ends of intervals, those that overlap put together."""
    order = np.argsort(taken.lower, kind="stable")
    lower, upper = taken.lower[order], np.maximum.accumulate(taken.upper[order])
    apart = lower[1:] > upper[:-1]
    edge = np.ones(min(len(lower), 1), np.bool_)
    starts, ends = np.concatenate([edge, apart]), np.concatenate([apart, edge])
    return [lower[starts].tolist(), upper[ends].tolist()]


def _bodies(atom: ast.StateAtom, env: Env) -> tuple[str, ...]:
    return tuple(env.get(arg, arg) for arg in atom.call.args)


def _state(evaluator: Evaluator, atom: ast.StateAtom, env: Env) -> str | None:
    """Name of a state's margins, as it holds under these values; None where frames tell it apart."""
    if evaluator.asks_costly(atom):
        return None
    declared = evaluator.rules.states.get(atom.call.name)
    digest = "" if declared is None else evaluator.digest(declared)
    return state_name(atom.call.name, _bodies(atom, env), digest)


def _side(limit: ast.Limit) -> str:
    """Which values come closest to a limit, or fail it."""
    return LEAST if limit.op[0] == ">" else GREATEST


# ---- and back


class Limit(NamedTuple):
    """What an entry of a condition compares, and with what.

    Attributes:
        row: what is kept of the series or state.
        side: from which of its ends the limit comes.
        margin: of a value.
        falls: the margin falls where values rise, so that its lower end comes of their upper one.
    """

    row: Value
    side: str
    margin: Callable[[float], float]
    falls: bool

    def least(self) -> tuple[float, float, int | None]:
        """Least margins of both ends, and the first frame that has the lower of these.

        None in place of the frame where an earlier one may have the same margin.
        """
        ends = self.row[self.side]
        (value, frame, before), (other, _, _) = ends[-self.falls], ends[self.falls - 1]
        lower = self.margin(value)
        told = before is None or self.margin(before) > lower
        return lower, self.margin(other), frame if told else None

    def at(self, place: int) -> float:
        """The lower end of the margin at one of the kept frames."""
        return self.margin(self.row["at"][-self.falls][place])


def compared(
    evaluator: Evaluator, kept: Value, condition: ast.Condition, env: Env
) -> list[list[Limit]] | None:
    """What each entry of a condition compares in a scope; None where it takes all frames to tell."""
    out = []
    for atom in condition.atoms:
        found = _limits(evaluator, kept["rows"], atom, env)
        if not found:
            return None
        out.append(found)
    return out


def bounds(limits: Sequence[Sequence[Limit]]) -> tuple[float, float, int | None]:
    """Least margins of a condition in a scope, at both ends, and the first frame that has the lower.

    The frame is counted from the scope's start. None in place of it where it takes all frames to
    tell. ``limits``: of each entry of the condition.
    """
    least = [limit.least() for found in limits for limit in found]
    lower, upper = min(one[0] for one in least), min(one[1] for one in least)
    frames = [frame for margin, _, frame in least if margin == lower]
    told = [frame for frame in frames if frame is not None]
    return lower, upper, min(told) if len(told) == len(frames) else None


def witness(
    kept: Value, limits: Sequence[Sequence[Limit]], condition: ast.Condition, search: Search,
    instance: Instance,
) -> Witness | None:  # fmt: skip
    """Which entry of a condition decided an instance, and its value there.

    None where it takes more than is kept to tell: at another frame, or of a state, whose own
    condition has to be looked at. ``search``: of the lower ends of margins.
    """
    frame = instance.frame - instance.scope.first
    if frame not in kept["frames"]:
        return None
    at = kept["frames"].index(frame)
    margins = [min([limit.at(at) for limit in found]) for found in limits]
    least = margins.index(min(margins))
    decisive, row = condition.atoms[least], limits[least][0].row
    if not isinstance(decisive, ast.SignalAtom):
        return None
    ends = [np.array([end[at]]) for end in row["at"]]
    series = Series(ends[0], ends[-1], row["dimension"])
    found = search.of_signal(decisive, instance.env, series, instance.frame)
    return or_tied(found, margins, margins[least])


def _limits(evaluator: Evaluator, rows: Value, atom: ast.Atom, env: Env) -> list[Limit]:
    """What an entry of a condition compares; nothing where that is not kept, or does not tell."""
    if isinstance(atom, ast.StateAtom):
        row = rows.get(_state(evaluator, atom, env) or "")
        if row is None:
            return []
        if atom.want:
            return [Limit(row, LEAST, float, False)]
        return [Limit(row, GREATEST, negated_margin, True)]
    if not isinstance(atom, ast.SignalAtom) or atom.since is not None:
        return []
    name, bodies, options, values, reach = evaluator.asked(atom, env)
    if name == "tilt" and evaluator.untilted(bodies[0]):
        return []
    if is_costly(name):
        row = rows.get(partial_name(name, bodies, options))
    else:
        cap, deep, slack = how(name, reach, values)
        row = rows.get(series_name(name, bodies, "", cap, deep, slack, options))
        if row is not None and slack:
            open_ = list(zip(*row["loose"], strict=True))
            if any(a <= value <= b for a, b in open_ for value in values):
                return []
    if row is None:
        return []
    scale = evaluator.scale(atom.call)
    return [
        Limit(row, _side(limit), partial(_margin, limit.op, value, scale), limit.op[0] == "<")
        for limit, value in zip(atom.limits, values, strict=True)
    ]


def _margin(op: str, limit: float, scale: float, value: float) -> float:
    """As ``values.limit_margin``, of one value."""
    found = (value - limit if op[0] == ">" else limit - value) / (abs(limit) or scale)
    return -TINY if found == 0 and len(op) == 1 else found
