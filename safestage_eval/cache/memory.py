"""What is remembered of one episode while it is judged: measured before, or measured now."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import ValidationError

from safestage_eval.episode import Episode, Header, as_judged
from safestage_eval.formats import EpisodeRef
from safestage_eval.formats.lazy_columns import StoredItems
from safestage_eval.formats.parquet.episode_row import mesh_keys
from safestage_eval.relations.measure import Relations
from safestage_eval.signals.series import Series
from safestage_eval.verdicts import EpisodeResult, Verdict
from safestage_eval.verdicts.memory import short

from .entry import Entry, Value
from .folder import CacheFolder
from .identity import RACY, code_version, stamp
from .log import Log
from .remembered import RememberedRelations, RememberedSignals
from .stored import plain, result, verdict

ABOUT = "about"
"""Name of the value that says which files, and which code, an entry is from."""


class Memory:
    """An episode that may not have to be opened, and everything that was found out about it.

    Measurements are kept by what was asked of the trace; answers (verdicts, moments of success,
    stretches of frames) by everything that they depend on, the state of the trace's files included.
    """

    def __init__(self, folder: CacheFolder, ref: EpisodeRef) -> None:
        """Look the episode up; what does not fit its files or this code is not there."""
        self._folder, self._ref = folder, ref
        noticed, self._before = time.time_ns(), stamp(ref)
        self._whose = ""
        """Which state of which files, and which code; empty where nothing may be kept."""
        if self._before is not None and code_version() and self._before[1] <= noticed - RACY:
            self._whose = f"{code_version()} {self._before[0]}"
        self._measured: dict[str, Value] = {}
        self._answered: dict[str, Any] = {}
        self._recalled: dict[str, Value | None] = {}

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

    @property
    def opened(self) -> bool:
        """Something was read from the trace."""
        return "_real" in vars(self)

    @cached_property
    def episode(self) -> Episode:
        """The episode as it is judged. Raises TraceError as ``as_judged``."""
        return as_judged(self._found())

    def _found(self) -> Episode:
        """The episode; of one that is known, nothing is read before it has to be measured."""
        about = self.about
        if about is None:
            return self._real
        try:
            header = Header.model_validate_json(about["header"])
        except ValidationError:
            self._entry = None
            return self._real
        known = Episode(
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
        vars(known)["_vouched"] = lambda _: str(about["trace_hash"])
        return known

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
        key = self.key(question)
        if key in self._answered:
            return self._answered[key]
        known = self._answers.get(key)
        if known is None:
            known = self._answered[key] = find()
        return known

    def key(self, question: str) -> str:
        """Under which the answer to a question is kept."""
        return short(f"{self._whose} {question}")

    def verdict(self, question: str, judge: Callable[[], Verdict]) -> Verdict:
        """A verdict that was reached before, or is now."""
        key = self.key(question)
        known = self._answers.get(key)
        if known is not None:
            return verdict(known)
        found = judge()
        self._answered[key] = plain(found)
        return found

    def result(self, question: str, judge: Callable[[], EpisodeResult]) -> EpisodeResult:
        """Everything that was said of the episode before, or is now."""
        key, path = self.key(question), self._ref.shown
        known = self._answers.get(key)
        if known is not None:
            return result(known, path)
        found = judge()
        self._answered[key] = plain(found)
        return found if found.path == path else replace(found, path=path)

    def save(self) -> None:
        """Write what is new, unless it was read from a file that changed since it was looked up."""
        if not (self._measured or self._answered) or not self._whose:
            return
        if self.opened and stamp(self._ref) != self._before:
            return
        if self._answered:
            self._folder.add(self._ref, self._answered, self._answers.used())
        if not self._measured:
            return
        known: dict[str, Value] = {
            ABOUT: {
                "whose": self._whose,
                "header": self.episode.header.model_dump_json(exclude_defaults=True),
                "channels": [list(key) for key in self.episode.channels],
                "t": np.asarray((self.episode.recorded or self.episode).t),
                "trace_hash": self.episode.trace_hash,
            }
        }
        if self._entry is not None:
            kept = {name: self._entry.get(name) for name in self._entry.names() if name != ABOUT}
            known |= {name: value for name, value in kept.items() if value is not None}
        self._folder.write(self._ref, known | self._measured)
