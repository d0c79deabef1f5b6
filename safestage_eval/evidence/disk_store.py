"""The store that keeps answers in a folder between runs (docs/performance.md says what is trusted).

The folder may be deleted at any time, shared by any number of processes, and cut off or damaged:
what is missing there is measured again.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from functools import cached_property
from typing import Any, cast

import numpy as np
from pydantic import ValidationError

from safestage_eval.episode import Episode, Header, as_judged
from safestage_eval.formats import EpisodeRef
from safestage_eval.formats.lazy_columns import StoredItems
from safestage_eval.formats.parquet.episode_row import mesh_keys

from .answer_log import Log
from .cache_entry import Entry, Value
from .cache_folder import CacheFolder
from .partial import Partial
from .query import Query
from .series import Series
from .store import Column, Store
from .trace_identity import RACY, code_version, stamp

_NOT_KEPT = object()

ABOUT = "about"
"""Name of the value that says which files, and which code, an entry is from."""


class DiskStore(Store):
    """An episode that may not have to be opened, and everything that was measured of it.

    Measurements are kept by their queries; answers (verdicts, moments of success, stretches of
    frames) by everything that they depend on, the state of the trace's files included.
    """

    lasting = True

    def __init__(self, folder: CacheFolder, ref: EpisodeRef) -> None:
        """Look the episode up in a folder; entries of other files or other code are ignored."""
        super().__init__()
        self._folder, self._ref = folder, ref
        noticed, self._before = time.time_ns(), stamp(ref)
        self._whose = ""
        """Identifies the state of the trace's files and the code; empty where nothing may be kept."""
        if self._before is not None and code_version() and self._before[1] <= noticed - RACY:
            self._whose = f"{code_version()} {self._before[0]}"
        self._new: set[Query] = set()
        """Queries whose answers are not in the file as they are now."""
        self._answered: dict[str, Any] = {}

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
        """Header, times and hash of the trace as they were kept; None if it has to be read."""
        return self._entry.get(ABOUT) if self._entry is not None else None

    @cached_property
    def _trace(self) -> Episode:
        return self._ref.open()

    @property
    def opened(self) -> bool:
        """Something was read from the trace, and not known from an earlier process."""
        return "_trace" in vars(self)

    @cached_property
    def episode(self) -> Episode:
        """The episode as it is judged. Raises TraceError as ``as_judged``."""
        return as_judged(self._kept_or_opened())

    def _kept_or_opened(self) -> Episode:
        """The episode; one that was kept is opened only when something has to be measured."""
        about = self.about
        if about is None:
            return self._trace
        try:
            header = Header.model_validate_json(about["header"])
        except ValidationError:
            self._entry = None
            return self._trace
        known = Episode(
            header=header,
            t=about["t"],
            tracks=StoredItems(
                [body.name for body in header.bodies], lambda name: self._trace.tracks[name]
            ),
            _contacts=lambda: self._trace.contacts,
            _frames=lambda: self._trace.frames,
            meshes=StoredItems(mesh_keys(header), lambda key: self._trace.meshes[key]),
            channels=StoredItems(
                [(body, name) for body, name in about["channels"]],
                lambda key: self._trace.channels[key],
            ),
            path=self._ref.path,
        )
        vars(known)["_vouched"] = lambda _: str(about["trace_hash"])
        return known

    # ---- measurements

    def unmeasured(self, query: Query, measure: Callable[[Any], Column | None]) -> Column | None:
        """Like the base class, but the kept answer as long as nothing is read from the trace."""
        known = self._known.get(query, _NOT_KEPT)
        if known is _NOT_KEPT:
            known = self._known[query] = self._kept(query)
        if known is _NOT_KEPT or self.opened:
            found = measure(None)
            if known is _NOT_KEPT:
                self._new.add(query)
            elif known is not None:  # more was read when it was kept
                found = known if found is None else known | found
                if not np.array_equal(found, known):
                    self._new.add(query)
            elif found is not None:
                self._new.add(query)
            known = self._known[query] = found
        return cast("Column | None", known)

    def _first(self, query: Query, measure: Callable[[Any], Any]) -> Any:
        found = self._kept(query)
        if found is not _NOT_KEPT:
            return found
        self._new.add(query)
        return measure(None)

    def _partial(self, query: Query, frames: int) -> Partial:
        if query not in self._known:
            found = self._kept(query)
            self._known[query] = Partial.blank(frames) if found is _NOT_KEPT else found
        return cast(Partial, self._known[query])

    def _added(self, query: Query) -> None:
        self._new.add(query)

    def _kept(self, query: Query) -> Any:
        """The answer in the file; ``_NOT_KEPT`` where there is none, or it is damaged."""
        if self._entry is None or query.kind == "force":
            return _NOT_KEPT
        stored = self._entry.get(query.digest)
        return _NOT_KEPT if stored is None else _unpacked(stored)

    # ---- answers

    def answer(self, question: str, find: Callable[[], Any]) -> Any:
        """The JSON answer to a question that names all that it depends on besides the trace."""
        key = self._key(question)
        if key in self._answered:
            return self._answered[key]
        known = self._answers.get(key)
        if known is None:
            known = self._answered[key] = find()
        return known

    def _key(self, question: str) -> str:
        """Under which the answer to a question is kept."""
        return hashlib.sha256(f"{self._whose} {question}".encode()).hexdigest()[:32]

    def save(self) -> None:
        """Write new answers, unless the trace changed since it was looked up."""
        if not (self._new or self._answered) or not self._whose:
            return
        if self.opened and stamp(self._ref) != self._before:
            return
        if self._answered:
            self._folder.add(self._ref, self._answered, self._answers.used())
        new = {q.digest: _packed(self._known[q]) for q in self._new if q.kind != "force"}
        if not new:
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
        self._folder.write(self._ref, known | new)


def _or_empty(column: Column | None) -> Column:
    return np.zeros(0, np.bool_) if column is None else column


def _packed(answer: Any) -> Value:
    """An answer as a value of the file. An empty column stands for None."""
    if isinstance(answer, Series):
        ends = {"lower": np.asarray(answer.lower)}
        if answer.upper is not answer.lower:
            ends["upper"] = np.asarray(answer.upper)
        return {"dimension": answer.dimension, "notes": list(answer.notes), **ends}
    if isinstance(answer, Partial):
        about = {f"about {i}": mask for i, mask in enumerate(answer.notes.values())}
        ends = {"lower": answer.lower, "upper": answer.upper}
        return {"notes": list(answer.notes), "done": answer.done, **ends, **about}
    if answer is None or isinstance(answer, np.ndarray):
        return {"column": _or_empty(answer)}
    return {"value": answer}


def _unpacked(stored: Value) -> Any:
    if "dimension" in stored:
        lower: Any = stored["lower"]
        upper: Any = stored.get("upper", lower)
        return Series(lower, upper, stored["dimension"], tuple(stored["notes"]))
    if "done" in stored:  # may be measured further
        lower, upper, done = (np.array(stored[part]) for part in ("lower", "upper", "done"))
        about = {note: np.array(stored[f"about {i}"]) for i, note in enumerate(stored["notes"])}
        return Partial(lower, upper, done, about)
    if "column" in stored:
        return stored["column"] if len(stored["column"]) else None
    return stored["value"]
