"""Signals and relations of an episode that are found out only when they are not remembered."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.relations.effect import SIGNALS as EFFECTS
from safestage_eval.relations.measure import COSTLY, Relations
from safestage_eval.signals.measure import Signals
from safestage_eval.signals.options import Options
from safestage_eval.signals.reference import Reference
from safestage_eval.signals.series import Series
from safestage_eval.verdicts.memory import short

from .stored import kept_partial, partial_of

if TYPE_CHECKING:
    from .memory import Memory

Bool = NDArray[np.bool_]


class RememberedSignals(Signals):
    """Signals that are measured only when they are not remembered."""

    def __init__(self, memory: Memory, baseline_frames: int, backend: str) -> None:
        super().__init__(memory.episode, baseline_frames, backend)
        self._memory = memory

    def key(self, *what: Any) -> str:
        """Name under which something is kept: what was asked, of whom, and how."""
        return f"{self.backend} {self.baseline.frames} {short(repr(what))}"

    def between_frames(self, name: str, bodies: Sequence[str], frame: int) -> float | None:
        """As in the base class."""
        key = self.key("between frames", name, tuple(bodies), frame)
        known = self._memory.recall(key)
        if known is None:
            known = {"value": super().between_frames(name, bodies, frame)}
            self._memory.keep(key, known)
        found: float | None = known["value"]
        return found

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
        key = self.key("signal", name, bodies, since, cap, deep, slack, options)

        def measure() -> Series:
            return super(RememberedSignals, self).measured(
                name, bodies, reference, cap, deep, slack, options
            )

        return self._memory.series(key, measure)


class RememberedRelations(Relations):
    """Relations, and signals of them, that are found out only when they are not remembered."""

    signals: RememberedSignals

    def __init__(self, signals: RememberedSignals, memory: Memory) -> None:
        super().__init__(signals)
        self._memory = memory
        self._at_hand: dict[str, tuple[Bool, Bool]] = {}

    @cached_property
    def blind(self) -> bool:
        """As in the base class."""
        key, gaps = self.signals.key("forces"), self.signals.gaps
        known = self._memory.recall(key)
        if known is None:
            known = {"recorded": gaps.forces}
            self._memory.keep(key, known)
        vars(gaps)["forces"] = known["recorded"]
        return not known["recorded"]

    def get(self, name: str, bodies: Sequence[str], wanted: Bool | None = None) -> Bool | None:
        """As in the base class."""
        if self.lacking(name, bodies):
            return None
        key = self.signals.key("relation", name, tuple(bodies))
        everywhere = np.ones(len(self.episode), np.bool_)
        asked = everywhere if wanted is None or name not in COSTLY else wanted
        known = self._remembered(key)
        if known is not None and not (asked & ~known[1]).any():
            return known[0]
        found = super().get(name, bodies, wanted)
        if found is None:
            return None
        if name in COSTLY:
            asked = asked | super().told(*bodies)
        return self._found(key, np.array(found), asked, known)

    def _remembered(self, key: str) -> tuple[Bool, Bool] | None:
        """(T,) truth, and where that was found out; None where nothing was."""
        if key not in self._at_hand:
            stored = self._memory.recall(key)
            if stored is None:
                return None
            self._at_hand[key] = stored["truth"], stored["done"]
        return self._at_hand[key]

    def _found(self, key: str, truth: Bool, asked: Bool, known: tuple[Bool, Bool] | None) -> Bool:
        """The truth (T,) of the asked frames, kept with what was ``known`` of others."""
        done = asked
        if known is not None:
            truth, done = np.where(asked, truth, known[0]), asked | known[1]
        self._at_hand[key] = truth, done
        self._memory.keep(key, {"truth": truth, "done": done})
        return truth

    def told(self, body: str, on: str) -> Bool:
        """Like the base class, but answer from the cache where it holds the relation."""
        if self.blind:
            return super().told(body, on)
        done: Bool = np.ones(len(self.episode), np.bool_)
        for name in ("depends_on", "caught"):
            known = self._remembered(self.signals.key("relation", name, (body, on)))
            done = done & known[1] if known is not None else np.zeros(len(done), np.bool_)
        return done

    def unmeasured(self, name: str, bodies: tuple[str, ...]) -> Bool | None:
        """As in the base class."""
        key = self.signals.key("unmeasured", name, bodies)
        known = self._memory.recall(key)
        if known is None:
            found = super().unmeasured(name, bodies)
            known = {"lost": np.zeros(0, np.bool_) if found is None else np.array(found)}
            self._memory.keep(key, known)
        lost: Bool = known["lost"]
        return lost if len(lost) else None

    def signal_unmeasured(self, name: str, bodies: tuple[str, ...]) -> Bool | None:
        """Like the base class; from the cache where nothing was read from the trace since."""
        key = self.signals.key("signal unmeasured", name, bodies)
        known = self._memory.recall(key)
        if known is None or self._memory.opened:
            found = super().signal_unmeasured(name, bodies)
            lost = np.zeros(0, np.bool_) if found is None else np.array(found)
            if known is None or not np.array_equal(known["lost"], lost):
                self._memory.keep(key, {"lost": lost})
            return found
        return known["lost"] if len(known["lost"]) else None

    def caught(self, body: str, on: str, wanted: Bool | None) -> Bool:
        """As in the base class, and remembered likewise."""
        key = self.signals.key("relation", "caught", (body, on))
        asked = np.ones(len(self.episode), np.bool_) if wanted is None else wanted
        known = self._remembered(key)
        if known is not None and not (asked & ~known[1]).any():
            return known[0]
        open_ = np.array(super().caught(body, on, wanted))
        return self._found(key, open_, asked | super().told(body, on), known)

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
        """As in the base class. What is measured at some frames only is kept for these."""
        if name in COSTLY:
            return self._costly(name, tuple(bodies), wanted, options)

        def measure() -> Series:
            return super(RememberedRelations, self).signal(
                name, bodies, reference, reach, wanted, options, limits
            )

        if name not in ("slip", "load_share", "fall", *EFFECTS):
            return measure()  # the signals remember
        since = reference.key if reference else ""
        key = self.signals.key("signal", name, tuple(bodies), since, *options)
        return self._memory.series(key, measure)

    def _costly(
        self, name: str, bodies: tuple[str, ...], wanted: Bool | None, options: Options
    ) -> Series:
        key = self.signals.key("partial", name, bodies, *([options] if options else []))
        if (name, bodies, options) not in self._partial:
            known = self._memory.recall(key)
            if known is not None:
                self._partial[name, bodies, options] = partial_of(known)
        before = self._partial.get((name, bodies, options))
        count = int(before.done.sum()) if before is not None else -1
        found = super().signal(name, bodies, wanted=wanted, options=options)
        partial = self._partial[name, bodies, options]
        if int(partial.done.sum()) != count:
            self._memory.keep(key, kept_partial(partial))
        return found
