"""A rule's meaning on an episode of which only what was kept of that rule is at hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NoReturn, cast

import numpy as np

from safestage_eval.episode import Clock, Episode
from safestage_eval.evidence.declare import Options, is_costly
from safestage_eval.evidence.measure import Signals
from safestage_eval.evidence.reference import Baseline, Reference
from safestage_eval.evidence.series import Series
from safestage_eval.relations.measure import Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.signals import SIGNALS
from safestage_eval.states.band import F64, Band, Bool
from safestage_eval.states.scope import Scope
from safestage_eval.verdicts.evaluate import Bounds, Evaluator
from safestage_eval.verdicts.memory import Memory
from safestage_eval.verdicts.values import Env

from .closest import Limit, bounds, compared, place, witness
from .entry import Entry, Value
from .judged import HEAD, TIME, band_of, time_of
from .names import partial_name, series_name, slack_name, state_name
from .stored import partial_of

if TYPE_CHECKING:
    from safestage_eval.verdicts.instance import Instance
    from safestage_eval.verdicts.witness import Search, Witness


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
        self.at_hand = kept.head["answers"]
        self.bounds, self.closest = self._bounds, self._closest
        # by identity: what is kept of a scope stays beside what it says under these values
        self._compared: dict[int, tuple[Value, list[list[Limit]] | None]] = {}
        self._moments: dict[tuple[str, tuple[str, ...]], tuple[Band, dict[str, None]]] = {}

    def under(self, params: Mapping[str, ast.Quantity | ast.Duration]) -> Recalled:
        """As in the base class."""
        found = Recalled(
            self.relations, self.rules, params, self.success,
            success_known=self.success_known, memory=cast(Memory, self.memory),
        )  # fmt: skip
        found.players = self.players
        return found

    def _kept(self, kind: str, what: ast.Alternative, env: Env, scope: Scope) -> Value | None:
        """What is kept of a condition that is required in a scope."""
        if kind != "require" or scope.sure is not None or not isinstance(what, ast.Condition):
            return None
        found: Value | None = self.relations.head["closest"].get(
            place(env, scope.first, scope.stop)
        )
        return found

    def _bounds(self, kind: str, what: ast.Alternative, env: Env, scope: Scope) -> Bounds | None:
        kept = self._kept(kind, what, env, scope)
        if kept is None:
            return None
        limits = compared(self, kept, cast(ast.Condition, what), env)
        self._compared[id(kept)] = kept, limits
        return None if limits is None else bounds(limits)

    def _closest(self, search: Search, instance: Instance) -> Witness | None:
        clause, scope = instance.clause, instance.scope
        if clause is None or search.upper:
            return None
        kept = self._kept(clause.kind, clause.what, instance.env, scope)
        if kept is None:
            return None
        limits = self._compared.get(id(kept), (kept, None))[1]
        if limits is None:
            return None
        return witness(kept, limits, cast(ast.Condition, clause.what), search, instance)

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
        if not is_costly(name):
            return self.signals.get(name, bodies, reference, reach, options, limits)
        known = partial_of(self.need(partial_name(name, bodies, options)))
        todo = np.ones(len(known.done), np.bool_) if wanted is None else wanted
        if len(known.missing(todo)):
            raise NotKept(name)
        return known.series(todo, SIGNALS[name].dimension)

    def may_touch_between(self, a: str, b: str, where: Bool) -> NoReturn:
        """As in the base class; it is not kept."""
        raise NotKept(a, b, where)

    def between_frames(self, name: str, bodies: Sequence[str], frame: int) -> float | None:
        """As in the base class."""
        if not SIGNALS[name].capped:
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

    def baseline_of(self, name: str) -> NoReturn:
        """As in the base class."""
        raise NotKept(name)

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
        self.unseen = None
        if head["unseen"]:
            self.unseen = np.zeros(len(t), np.bool_)
            self.unseen[head["unseen"]] = True
        self.clock = Clock(t, self.dt, self.unseen)
        self.termination, self.success_time = head["termination"], head["success_time"]

    def __len__(self) -> int:
        return len(self.t)

    def __getattr__(self, name: str) -> NoReturn:
        raise NotKept(f"episode.{name}")
