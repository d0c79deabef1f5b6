"""A rule's meaning on an episode of which only what was kept of that rule is at hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, NoReturn, cast

import numpy as np

from safestage_eval.episode import Episode
from safestage_eval.relations.measure import COSTLY, Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.signals.measure import CAPPED, Signals, how
from safestage_eval.signals.options import Options
from safestage_eval.signals.reference import Baseline, Reference
from safestage_eval.signals.series import Series
from safestage_eval.signals.vocabulary import SIGNALS
from safestage_eval.states.band import F64, TINY, Band, Bool
from safestage_eval.states.scope import Scope
from safestage_eval.verdicts.evaluate import Bounds, Evaluator
from safestage_eval.verdicts.memory import Memory
from safestage_eval.verdicts.values import Env, reach_of

from .entry import Entry, Value
from .judged import HEAD, TIME, band_of, partial_name, series_name, slack_name, state_name, time_of
from .stored import partial_of


class NotKept(Exception):  # noqa: N818 - it is no error
    """Something is asked for that was not kept: the rule has to be judged as if for the first time."""


class Recalled(Evaluator):
    """The evaluator of one rule that measures nothing.

    It computes what depends on the values of parameters as every evaluator does, from the kept
    series, and takes states that do not depend on them as they were. Raises NotKept otherwise.
    """

    relations: KeptRelations

    def __init__(
        self,
        kept: KeptRelations,
        rules: ast.RuleSet,
        params: Mapping[str, ast.Quantity | ast.Duration],
        success: int | None,
        *,
        success_known: bool,
        memory: Memory,
    ) -> None:
        """Arguments as in the base class."""
        super().__init__(kept, rules, params, success, success_known=success_known, memory=memory)
        self.at_hand, self.bounds = kept.head["answers"], self._bounds
        self._moments: dict[tuple[str, tuple[str, ...]], tuple[Band, dict[str, None]]] = {}

    def under(self, params: Mapping[str, ast.Quantity | ast.Duration]) -> Recalled:
        """As in the base class."""
        found = Recalled(
            self.relations, self.rules, params, self.success,
            success_known=self.success_known, memory=cast(Memory, self.memory),
        )  # fmt: skip
        found.players = self.players
        return found

    def _bounds(self, kind: str, what: ast.Alternative, env: Env, scope: Scope) -> Bounds | None:
        """Of limits that all have to be kept, from the series' extremes."""
        if kind != "require" or scope.sure is not None or not isinstance(what, ast.Condition):
            return None
        outer, self.notes = self.notes, {}
        try:
            ends = [self._extreme(atom, env, scope) for atom in what.atoms]
        finally:
            self.notes = outer
        found = [end for end in ends if end is not None]
        if len(found) < len(ends):
            return None
        return min(lower for lower, _ in found), min(upper for _, upper in found)

    def _extreme(self, atom: ast.Atom, env: Env, scope: Scope) -> tuple[float, float] | None:
        """Least margins of an atom in a scope."""
        if not isinstance(atom, ast.SignalAtom) or atom.since is not None:
            return None
        name, bodies, options = self.measured(atom.call, env)
        if name in COSTLY or (name == "tilt" and self.untilted(bodies[0])):
            return None
        values = [(limit.op, self.number(limit.value, env)) for limit in atom.limits]
        found = self.relations.extremes(
            name, bodies, options, [value for _, value in values], scope
        )
        if found is None:
            return None
        scale = self.scale(atom.call)
        margins = [_margins(found, op, value, scale) for op, value in values]
        return min(lower for lower, _ in margins), min(upper for _, upper in margins)

    def _declared(self, name: str, bodies: tuple[str, ...]) -> Band:
        digest = self.digest(self.rules.states[name])
        known = self.relations.value(state_name(name, bodies, digest))
        if known is None:
            return super()._declared(name, bodies)
        self.notes.update(dict.fromkeys(known["notes"]))
        return band_of(known)

    def _relation(self, name: str, bodies: tuple[str, ...], _: Bool | None = None) -> Band:
        known = self.relations.need(state_name(name, bodies, ""))
        self.notes.update(dict.fromkeys(known["notes"]))
        return band_of(known)

    def momentary(self, name: str, bodies: tuple[str, ...]) -> Band:
        """As in the base class."""
        key = name, bodies
        if key not in self._moments:
            outer, self.notes = self.notes, {}
            self._moments[key] = super().momentary(name, bodies), self.notes
            self.notes = outer
        found, notes = self._moments[key]
        self.notes.update(notes)
        return found

    def material(self, player: str) -> str:
        """As in the base class."""
        return cast(str, self.relations.body(player)[0])

    def untilted(self, name: str) -> bool:
        """As in the base class."""
        return cast(bool, self.relations.body(name)[1])


class Extremes(NamedTuple):
    """Least and greatest values of both ends of a series in a scope."""

    low: float
    most_low: float
    high: float
    most_high: float


class KeptRelations(Relations):
    """The series of a rule, by what they measure; whatever else is asked for was not kept."""

    signals: KeptSignals

    def __init__(self, entry: Entry, backend: str) -> None:
        """Raises NotKept where the entry is damaged."""
        self._entry = entry
        self._values: dict[str, Value | None] = {}
        self.head = self.need(HEAD)
        self.episode = cast(Episode, KeptEpisode(self.head, time_of(self.need(TIME))))
        self.signals = KeptSignals(self, backend)

    def value(self, name: str) -> Value | None:
        """What is kept under a name."""
        if name not in self._values:
            self._values[name] = self._entry.get(name)
        return self._values[name]

    def need(self, name: str) -> Value:
        """What is kept under a name; raises NotKept."""
        found = self.value(name)
        if found is None:
            raise NotKept(name)
        return found

    def body(self, name: str) -> list[Any]:
        """Material of a body, and whether it has no tilt."""
        if name not in self.head["bodies"]:
            raise NotKept(name)
        return cast("list[Any]", self.head["bodies"][name])

    def get(self, name: str, bodies: Sequence[str], wanted: Bool | None = None) -> NoReturn:
        """Relations are kept as states."""
        raise NotKept(name, bodies, wanted)

    def signal(
        self,
        name: str,
        bodies: Sequence[str],
        reference: Reference | None = None,
        reach: float = 0,
        wanted: Bool | None = None,
        options: Options = (),
        limits: Sequence[float] = (),
    ) -> Series:
        """As in the base class."""
        if name not in COSTLY:
            return self.signals.get(name, bodies, reference, reach, options, limits)
        known = partial_of(self.need(partial_name(name, bodies)))
        todo = np.ones(len(known.done), np.bool_) if wanted is None else wanted
        if len(known.missing(todo)):
            raise NotKept(name)
        return known.series(todo, SIGNALS[name].dimension)

    def extremes(
        self,
        name: str,
        bodies: Sequence[str],
        options: Options,
        limits: Sequence[float],
        scope: Scope,
    ) -> Extremes | None:
        """Of a series that is compared with limits, in a scope; None where they were not kept."""
        cap, deep, slack = how(name, reach_of(limits), limits)
        known = self.head["extremes"].get(series_name(name, bodies, "", cap, deep, slack, options))
        if known is None:
            return None
        ends = zip(*known["loose"], strict=True)
        if slack and any(a <= limit <= b for a, b in ends for limit in limits):
            return None
        found = known["scopes"].get(f"{scope.first} {scope.stop}")
        return None if found is None else Extremes(*found)

    def between_frames(self, name: str, bodies: Sequence[str], frame: int) -> float | None:
        """As in the base class."""
        if name not in CAPPED:
            return None
        asked = slack_name(name, bodies, frame)
        if asked not in self.head["slacks"]:
            raise NotKept(asked)
        return cast("float | None", self.head["slacks"][asked])


class KeptSignals(Signals):
    """Signals as they were measured."""

    def __init__(self, kept: KeptRelations, backend: str) -> None:
        """``backend``: whose clearances they are."""
        self.backend, self.baseline = backend, Baseline(kept.head["baseline"])
        self._kept = kept
        self._slack, self._series = {}, dict[str, Series]()

    def measured(
        self,
        name: str,
        bodies: tuple[str, ...],
        reference: Reference | None,
        cap: float,
        deep: bool,
        slack: float,
        options: Options,
    ) -> Series:
        """As in the base class."""
        since = reference.key if reference else ""
        key = series_name(name, bodies, since, cap, deep, slack, options)
        found = self._series.get(key)
        if found is None:
            known = self._kept.need(key)
            lower: Any = known["lower"]
            upper, notes = known.get("upper", lower), tuple(known["notes"])
            found = self._series[key] = Series(lower, upper, known["dimension"], notes)
        return found


class KeptEpisode:
    """Of an episode, its times, and when and how it ended."""

    def __init__(self, head: Value, t: F64) -> None:
        self.t, self.dt, self.header = t, head["dt"], self
        self.termination, self.success_time = head["termination"], head["success_time"]

    def __len__(self) -> int:
        return len(self.t)

    def __getattr__(self, name: str) -> NoReturn:
        raise NotKept(f"episode.{name}")


def _margins(found: Extremes, op: str, limit: float, scale: float) -> tuple[float, float]:
    """Least margins of a comparison at both ends; as ``limit_margin``, which keeps their order."""
    size, up = abs(limit) or scale, op[0] == ">"
    low, high = (found.low, found.high) if up else (found.most_high, found.most_low)
    ends = [(value - limit if up else limit - value) / size for value in (low, high)]
    if len(op) == 1:
        ends = [-TINY if end == 0 else end for end in ends]
    return ends[0], ends[1]
