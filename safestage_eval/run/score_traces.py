"""A whole run: found, chosen, judged by an engine, kept in parts, and given back in order."""

from __future__ import annotations

import os
import shutil
import sys
import time
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, redirect_stdout
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING
from weakref import finalize

from safestage_eval.formats import EpisodeRef
from safestage_eval.formats.discover import find
from safestage_eval.formats.episode_filter import Selection
from safestage_eval.verdicts.problem import Problem

from .bind_checks import require_match
from .gates import Gates
from .result_parts import Line, Parts
from .score_many import score_many
from .scores import Scores, deduplicate, taken, titles
from .settings import Settings
from .stored_results import StoredResults
from .stratified_sample import sample

if TYPE_CHECKING:
    from .pool import Numbered
    from .result_keys import Keys

IN_MEMORY = 1000
"""Results that are held; those of a longer run go to disk at once."""

PART_RESULTS, PART_BYTES, PART_TIME = 64, 1 << 21, 10.0
"""Results, bytes and s of waiting after which a part is written."""

Tell = Callable[[int, int | None], None]


@dataclass(frozen=True)
class Choice:
    """Which episodes, and where and how they are judged.

    Attributes:
        where: header field → wanted value.
        sample: judge only so many, spread over stages, tasks and policies; None: all.
        seed: of the sample.
        resume: folder that keeps finished results; None: none is kept.
        engine: ``local`` or ``ray``.
        address: of the Ray cluster; None: the one of this environment, or a new one right here.
        jobs: worker processes; None: one per processor.
    """

    where: Mapping[str, str] | None = None
    sample: int | None = None
    seed: int = 0
    resume: Path | None = None
    engine: str = "local"
    address: str | None = None
    jobs: int | None = None


def score_traces(
    traces: Sequence[str | Path],
    settings: Settings,
    choice: Choice | None = None,
    progress: Tell | None = None,
) -> Scores:
    """Judge what is found under the paths.

    A short run is held in memory. Of a long one, or one that is to be resumed, each result goes to
    disk when it is reached, and a run that was killed goes on after the last part that it wrote.

    Args:
        traces: files and folders.
        settings: from ``load_settings``.
        choice: which episodes, and where.
        progress: called with (done, total) after each episode; total is None as long as it is not known.

    Raises:
        TraceError, InputError: as ``score_paths``, and when results cannot be written.
    """
    choice = choice or Choice()
    if settings.bind is not None:
        require_match(settings.bind, Selection(find(traces), choice.where))
    chosen = Selection(find(traces), choice.where)
    refs, note = iter(chosen), ""
    if choice.sample is not None:
        picked = sample(refs, choice.sample, choice.seed)
        refs, note = iter(picked.refs), picked.told
    held = None
    if choice.resume is None and choice.engine == "local":
        first = list(islice(refs, IN_MEMORY + 1))
        refs = chain(first, refs)
        held = first if len(first) <= IN_MEMORY else None
    if held is not None:
        scores = _in_memory(held, settings, choice.jobs, progress)
    else:
        scores = _on_disk(refs, settings, choice, progress)
    left_out = dict.fromkeys(chosen.aborted)
    for result in scores.results if left_out else ():
        left_out.pop(result.episode_id, None)  # it was tried again
    return replace(scores, sample=note, aborted=tuple(left_out), gates=Gates.of(settings.rules))


def _in_memory(
    refs: Sequence[EpisodeRef], settings: Settings, jobs: int | None, progress: Tell | None
) -> Scores:
    results, problems, copies = deduplicate(
        score_many(refs, settings=settings, jobs=jobs, progress=progress)
    )
    return Scores(tuple(results), tuple(problems), titles(settings.rule_set), tuple(copies))


def _on_disk(
    refs: Iterable[EpisodeRef],
    settings: Settings,
    choice: Choice,
    progress: Tell | None,
) -> Scores:
    with ExitStack() as until:
        if choice.resume is None:
            folder = _Passing()
            place = folder.path
        else:
            folder, place = None, choice.resume
        keys = None
        if choice.resume is not None:  # else nobody asks
            from .result_keys import Keys

            keys = Keys(settings)
        ledger = _Ledger(Parts(place / "parts"), keys, progress, folder)
        if choice.engine == "ray":
            from .ray_cluster import judge

            with redirect_stdout(sys.stderr):  # where Ray tells of processes that died
                judge(ledger.todo(refs), ledger, settings, choice.address)
        else:
            from .pool import Local

            engine = until.enter_context(
                Local(choice.jobs or os.cpu_count() or 1, settings, lines=True)
            )
            try:
                for number, result in engine.run(ledger.todo(refs)):
                    ledger.note(number, result)
            finally:
                ledger.flush()
    return ledger.scores(titles(settings.rule_set))


class _Passing:
    """A folder that goes with the last one who holds this."""

    def __init__(self) -> None:
        self.path = Path(mkdtemp(prefix="safestage-results-"))
        finalize(self, shutil.rmtree, self.path, ignore_errors=True)


class _Ledger:
    """Outcome of each episode by its number: a result among the parts, or a problem."""

    def __init__(
        self, parts: Parts, keys: Keys | None, progress: Tell | None, folder: object | None
    ) -> None:
        """``keys``: None where nothing is known from before; ``folder``: is kept with the results."""
        self.parts, self._keys, self._progress = parts, keys, progress
        self._folder = folder
        self._rows = array("q")
        self._paths: list[str] = []
        self._problems: dict[int, Problem] = {}
        self._waiting: list[tuple[int, str, Line]] = []
        self._asked: dict[int, str] = {}
        self._bytes = self._done = 0
        self._since = 0.0
        self._all = False

    @property
    def folder(self) -> Path:
        """Folder of the parts."""
        return self.parts.folder.absolute()

    def todo(self, refs: Iterable[EpisodeRef]) -> Iterator[Numbered]:
        """The episodes without a result yet."""
        for number, ref in enumerate(refs):
            path = ref.shown
            self._paths.append(self._paths[-1] if self._paths and self._paths[-1] == path else path)
            key = None if self._keys is None else self._keys.of(ref)
            row = self.parts.find(key) if key is not None else None
            self._rows.append(-1 if row is None else row)
            if row is not None:
                self._tell()
                continue
            self._asked[number] = key or f"{number:032x}"
            yield number, ref
        self._all = True

    def key(self, number: int) -> str:
        """Under which the result of an episode that is being judged is kept."""
        return self._asked[number]

    def note(self, number: int, result: object) -> None:
        """Take results from an engine; they are written together with others."""
        key = self._asked.pop(number)
        if isinstance(result, Problem):
            self._problems[number] = result
        else:
            assert isinstance(result, Line)
            self._waiting.append((number, key, result))
            self._bytes += len(result.text)
            if len(self._waiting) == 1:
                self._since = time.monotonic()
            waited = time.monotonic() - self._since
            enough = len(self._waiting) >= PART_RESULTS or self._bytes >= PART_BYTES
            if enough or waited >= PART_TIME:
                self.flush()
        self._tell()

    def written(self, name: str, numbers: Sequence[int]) -> None:
        """A part that somebody else wrote, and whose results are in it, in its order."""
        for number, row in zip(numbers, self.parts.adopt(name), strict=True):
            del self._asked[number]
            self._rows[number] = row
            self._tell()

    def flush(self) -> None:
        """Write what waits."""
        if not self._waiting:
            return
        rows = self.parts.add([(key, line) for _, key, line in self._waiting])
        for (number, _, _), row in zip(self._waiting, rows, strict=True):
            self._rows[number] = row
        self._waiting.clear()
        self._bytes = 0

    def _tell(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, len(self._rows) if self._all else None)

    def scores(self, rules: Mapping[str, str]) -> Scores:
        """Each episode once, in the order in which they were found (see ``deduplicate``)."""
        rows, paths = array("q"), list[str]()
        first: dict[int, int] = {}
        problems, copies = [], []
        for number, row in enumerate(self._rows):
            if row < 0:
                problems.append(self._problems[number])
                continue
            before = first.setdefault(self.parts.episode(row), number)
            if before == number:
                rows.append(row)
                paths.append(self._paths[number])
            elif self.parts.trace(self._rows[before]) == self.parts.trace(row):
                copies.append(self._paths[number])
            else:
                again = StoredResults(self.parts, [row], [self._paths[number]])[0]
                problems.append(taken(again.episode_id, again.path, self._paths[before]))
        results = StoredResults(self.parts, rows, paths, self._folder)
        return Scores(results, tuple(problems), rules, tuple(copies))
