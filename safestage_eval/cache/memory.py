"""What is remembered of one episode while it is judged: measured before, or measured now."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from safestage_eval.episode import Episode, Header
from safestage_eval.formats import EpisodeRef
from safestage_eval.formats.episode_row import mesh_keys
from safestage_eval.formats.lazy import StoredItems
from safestage_eval.relations.measure import COSTLY, Relations
from safestage_eval.relations.partial import Partial
from safestage_eval.rules import Binding
from safestage_eval.rules import syntax as ast
from safestage_eval.signals.measure import Signals
from safestage_eval.signals.options import Options
from safestage_eval.signals.reference import Reference
from safestage_eval.signals.series import Series
from safestage_eval.verdicts import EpisodeResult, Verdict
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.judge import Judge
from safestage_eval.verdicts.memory import short

from .entry import Entry, Value
from .folder import CacheFolder
from .identity import RACY, code_version, stamp
from .judged import series_name, slack_name, values_of
from .log import Log
from .outline import outline_of
from .stored import plain, result, verdict

Bool = NDArray[np.bool_]

ABOUT = "about"
"""Name of the value that says which files, and which code, an entry is from."""


class Memory:
    """An episode that may not have to be opened, and everything that was found out about it.

    Measurements are kept by what was asked of the trace; answers (verdicts, moments of success,
    stretches of frames) by everything that they depend on, the state of the trace's files included.
    """

    def __init__(self, folder: CacheFolder, ref: EpisodeRef, outline: str = "") -> None:
        """Looks the episode up; what does not fit its files or this code is not there.

        ``outline``: the question under which its outline is kept.
        """
        self._folder, self._ref, self._outline = folder, ref, outline
        noticed, self._before = time.time_ns(), stamp(ref)
        self._whose = ""
        """Which state of which files, and which code; empty where nothing may be kept."""
        if self._before is not None and code_version() and self._before[1] <= noticed - RACY:
            self._whose = f"{code_version()} {self._before[0]}"
        self._measured: dict[str, Value] = {}
        self._answered: dict[str, Any] = {}
        self._recalled: dict[str, Value | None] = {}
        self._judged: dict[str, dict[str, Value]] = {}

    @cached_property
    def _answers(self) -> Log:
        return self._folder.answers(self._ref) if self._whose else Log(b"")

    @cached_property
    def _entry(self) -> Entry | None:
        entry = self._folder.measured(self._ref) if self._whose else None
        about = entry.get(ABOUT) if entry is not None else None
        return entry if about is not None and about.get("whose") == self._whose else None

    @property
    def about(self) -> Value | None:
        """What is known of the trace besides measurements; None if it has to be read."""
        return self._entry.get(ABOUT) if self._entry is not None else None

    @cached_property
    def _real(self) -> Episode:
        return self._ref.open()

    @cached_property
    def episode(self) -> Episode:
        """The episode; of one that is known, nothing is read before it has to be measured."""
        about = self.about
        if about is None:
            return self._real
        try:
            header = Header.model_validate_json(about["header"])
        except ValidationError:
            self._entry = None
            return self._real
        return Episode(
            header=header,
            t=about["t"],
            tracks=StoredItems(
                [body.name for body in header.bodies], lambda name: self._real.tracks[name]
            ),
            _contacts=lambda: self._real.contacts,
            _frames=lambda: self._real.frames,
            meshes=StoredItems(mesh_keys(header), lambda key: self._real.meshes[key]),
            channels=StoredItems(
                [(body, name) for body, name in about["channels"]],
                lambda key: self._real.channels[key],
            ),
            path=self._ref.path,
        )

    def relations(self, baseline_frames: int, backend: str = "gjk") -> Relations:
        """Relations and signals of the episode: from memory, or measured and kept."""
        signals = RememberedSignals(self, baseline_frames, backend)
        return RememberedRelations(signals, self)

    # ---- measurements

    def recall(self, key: str) -> Value | None:
        """What was measured under a name; None if nothing was, or it is damaged."""
        if key not in self._recalled:
            self._recalled[key] = self._entry.get(key) if self._entry is not None else None
        return self._measured.get(key) or self._recalled[key]

    def keep(self, key: str, value: Value) -> None:
        """Remember a measurement from now on."""
        self._measured[key] = value

    def series(self, key: str, measure: Callable[[], Series]) -> Series:
        """A series that was measured before, or is now."""
        known = self.recall(key)
        if known is None:
            found = measure()
            known = {
                "lower": np.asarray(found.lower),
                "dimension": found.dimension,
                "notes": list(found.notes),
            }
            if found.upper is not found.lower:
                known["upper"] = np.asarray(found.upper)
            self.keep(key, known)
        lower = known["lower"]
        upper = known.get("upper")
        return Series(
            lower, lower if upper is None else upper, known["dimension"], tuple(known["notes"])
        )

    # ---- answers

    def answer(self, question: str, find: Callable[[], Any]) -> Any:
        """The answer (JSON) to a question that names all it depends on besides the trace."""
        key = self._key(question)
        if key in self._answered:
            return self._answered[key]
        known = self._answers.get(key)
        if known is None:
            known = self._answered[key] = find()
        return known

    def known(self, question: str) -> Any:
        """The answer (JSON) that was found before; None if there is none."""
        key = self._key(question)
        return self._answered.get(key) or self._answers.get(key)

    def verdict(self, question: str, judge: Callable[[], Verdict]) -> Verdict:
        """A verdict that was reached before, or is now."""
        key = self._key(question)
        known = self._answers.get(key)
        if known is not None:
            return verdict(known)
        found = judge()
        self._answered[key] = plain(found)
        return found

    def result(self, question: str, judge: Callable[[], EpisodeResult]) -> EpisodeResult:
        """Everything that was said of the episode before, or is now."""
        key, path = self._key(question), str(self._ref.path)
        known = self._answers.get(key)
        if known is not None:
            return result(known, path)
        found = judge()
        self._answered[key] = plain(found)
        return found if found.path == path else replace(found, path=path)

    def _key(self, question: str) -> str:
        return short(f"{self._whose} {question}")

    # ---- rules

    def outline(self) -> Any:
        """What holds of the episode under all values (JSON); None where that was not kept."""
        return self.known(self._outline) if self._folder.measurements else None

    def keep_outline(self, judge: Judge, binding: Binding, found: EpisodeResult) -> None:
        """Keep what holds of the episode under all values, for ``judge_again``."""
        if self._outline and self._folder.measurements:
            known = outline_of(judge, binding, found)
            if known is not None:
                self._answered[self._key(self._outline)] = known

    def keep_judged(
        self,
        question: str,
        evaluator: Evaluator,
        rule: ast.Rule,
        players: Mapping[str, Sequence[str]],
    ) -> None:
        """Keep what judging a rule again takes; ``question`` names all that it depends on."""
        if self._whose and self._folder.measurements:
            values = values_of(evaluator, rule, players)
            values[ABOUT] = {"whose": self._whose, "question": short(question)}
            self._judged[rule.code] = values

    def judged(self, question: str, rule: ast.Rule) -> Entry | None:
        """What was kept of a rule."""
        entry = self._folder.judged(self._ref, rule.code) if self._whose else None
        about = entry.get(ABOUT) if entry is not None else None
        if about is None or about.get("whose") != self._whose:
            return None
        return entry if about.get("question") == short(question) else None

    def save(self) -> None:
        """Write what is new, unless it was read from a file that changed since it was looked up."""
        if not (self._measured or self._answered) or not self._whose:
            return
        read = "_real" in self.__dict__
        if read and stamp(self._ref) != self._before:
            return
        if self._answered:
            self._folder.add(self._ref, self._answered, self._answers.used())
        for code, values in self._judged.items():
            self._folder.write_judged(self._ref, code, values)
        if not self._measured:
            return
        known: dict[str, Value] = {
            ABOUT: {
                "whose": self._whose,
                "header": self.episode.header.model_dump_json(exclude_defaults=True),
                "channels": [list(key) for key in self.episode.channels],
                "t": np.asarray(self.episode.t),
            }
        }
        if self._entry is not None:
            kept = {name: self._entry.get(name) for name in self._entry.names() if name != ABOUT}
            known |= {name: value for name, value in kept.items() if value is not None}
        self._folder.write(self._ref, known | self._measured)


class RememberedSignals(Signals):
    """Signals that are measured only when they are not remembered."""

    def __init__(self, memory: Memory, baseline_frames: int, backend: str) -> None:
        super().__init__(memory.episode, baseline_frames, backend)
        self._memory = memory
        self.slacks: dict[str, float | None] = {}
        """What values may differ by between frames, as far as that was asked."""
        self.seen: dict[str, tuple[Series, float]] | None = None
        """The series that are asked for are collected here by name, each with its cap."""

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
        self.slacks[slack_name(name, bodies, frame)] = found
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

        found = self._memory.series(key, measure)
        if self.seen is not None:
            self.seen[series_name(name, bodies, since, cap, deep, slack, options)] = found, cap
        return found


class RememberedRelations(Relations):
    """Relations, and signals of them, that are found out only when they are not remembered."""

    signals: RememberedSignals

    def __init__(self, signals: RememberedSignals, memory: Memory) -> None:
        super().__init__(signals)
        self._memory = memory
        self._at_hand: dict[str, tuple[Bool, Bool]] = {}

    def get(self, name: str, bodies: Sequence[str], wanted: Bool | None = None) -> Bool | None:
        """As in the base class."""
        if self.lacking(name, bodies):
            return None
        key = self.signals.key("relation", name, tuple(bodies))
        everywhere = np.ones(len(self.episode), np.bool_)
        asked = everywhere if wanted is None or name not in COSTLY else wanted
        known = self._at_hand.get(key)
        if known is None:
            stored = self._memory.recall(key)
            if stored is not None:
                known = stored["truth"], stored["done"]
        if known is not None and not (asked & ~known[1]).any():
            self._at_hand[key] = known
            remembered: Bool = known[0]
            return remembered
        found = super().get(name, bodies, wanted)
        if found is None:
            return None
        truth, done = np.array(found), np.array(asked)
        if known is not None:
            truth, done = np.where(done, truth, known[0]), done | known[1]
        self._at_hand[key] = truth, done
        self._memory.keep(key, {"truth": truth, "done": done})
        return truth

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
            return self._costly(name, tuple(bodies), wanted)

        def measure() -> Series:
            return super(RememberedRelations, self).signal(
                name, bodies, reference, reach, wanted, options, limits
            )

        if name not in ("slip", "load_share"):
            return measure()  # the signals remember
        since = reference.key if reference else ""
        return self._memory.series(self.signals.key("signal", name, tuple(bodies), since), measure)

    def _costly(self, name: str, bodies: tuple[str, ...], wanted: Bool | None) -> Series:
        key = self.signals.key("partial", name, bodies)
        if (name, bodies) not in self._partial:
            known = self._memory.recall(key)
            if known is not None:
                lower, upper, done = (np.array(known[part]) for part in ("lower", "upper", "done"))
                about = [np.array(known[f"about {i}"]) for i in range(len(known["notes"]))]
                self._partial[name, bodies] = Partial(
                    lower, upper, done, dict(zip(known["notes"], about, strict=True))
                )
        before = self._partial.get((name, bodies))
        count = int(before.done.sum()) if before is not None else -1
        found = super().signal(name, bodies, wanted=wanted)
        value = self.partial(name, bodies)
        if value is not None and int(value["done"].sum()) != count:
            self._memory.keep(key, value)
        return found

    def partial(self, name: str, bodies: tuple[str, ...]) -> Value | None:
        """What was measured at some frames so far."""
        found = self._partial.get((name, bodies))
        if found is None:
            return None
        value: Value = {
            "lower": found.lower,
            "upper": found.upper,
            "done": found.done,
            "notes": list(found.notes),
        }
        return value | {f"about {i}": mask for i, mask in enumerate(found.notes.values())}
