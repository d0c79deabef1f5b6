"""Reading of sources in this process, or in child processes that may hang, grow or die."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from safestage_eval._process.children import Children, Ended, Question
from safestage_eval._process.closing import Closing
from safestage_eval.errors import InputError

from .import_episode import Failed, Imported, Target, Task, fingerprint_of, import_one
from .importer import Importer, SourceError
from .registry import importer, importers, recognise, unrecognised

GIVEN_UP = 3
"""Episodes of a source in a row that end their process or pass its bounds; the rest is not tried."""

AT_LEAST = 120.0
"""s that examining a source, or importing an episode, may take however small the source is."""

PER_BYTE = 2e-6
"""s more for each byte of the source: 2 s per MB, some ten times what the slowest formats take."""


@dataclass(frozen=True)
class Limits:
    """Bounds on each question about a source, and on each episode.

    Attributes:
        timeout: s; None: ``AT_LEAST``, and more for large sources.
        memory: bytes that the process which reads may hold; None: any.
    """

    timeout: float | None = None
    memory: int | None = None
    _seconds: dict[Path, float] = field(default_factory=dict, compare=False, repr=False)

    def seconds(self, source: Path) -> float:
        """Return the s for examining a file or folder, or for reading one episode of it."""
        if self.timeout is not None:
            return self.timeout
        if source not in self._seconds:
            self._seconds[source] = AT_LEAST + PER_BYTE * _size(source)
        return self._seconds[source]


def _size(source: Path) -> int:
    """Bytes of a file, or of all files below a folder."""
    if not source.is_dir():
        return _bytes(source)
    return sum(_bytes(Path(folder, name)) for folder, _, names in os.walk(source) for name in names)


def _bytes(file: Path) -> int:
    try:
        return file.stat().st_size
    except OSError:
        return 0


class Reader:
    """Answers questions about sources; the source that was read last stays open."""

    def __init__(self, target: Target) -> None:
        """Nothing is open."""
        self.target = target
        self._key: tuple[str, Path] | None = None
        self._open: Importer | None = None

    def answer(self, question: Any) -> Any:
        """Import an episode (a ``Task``), or call a method by ``(name, *arguments)``.

        Returns:
            What the method returns, or an InputError that it raised; of an episode, Imported or
            Failed.
        """
        if isinstance(question, Task):
            return self._import(question)
        name, *arguments = question
        try:
            return getattr(self, name)(*arguments)
        except InputError as error:
            return error

    def format(self, path: Path, only: str | None) -> tuple[str, str] | None:
        """See ``registry.recognise``."""
        return recognise(path, only)

    def unrecognised(self, path: Path, only: str | None) -> SourceError:
        """See ``registry.unrecognised``."""
        return unrecognised(path, only)

    def episodes(self, path: Path, format: str) -> list[str]:  # noqa: A002
        """Return the names of a source's episodes, in order."""
        return list(self._source(format, path).episodes())

    def fingerprint(self, path: Path, task: Task) -> str:
        """Return the digest of a task's data, and of the settings that they are read with."""
        return fingerprint_of(self._source(task.format, path), task.name, self.target)

    def close(self) -> None:
        """Let go of the source that is open."""
        if self._open is not None:
            self._open.close()
        self._open = self._key = None

    def _source(self, name: str, path: Path) -> Importer:
        if self._open is None or (name, path) != self._key:
            self.close()
            self._open, self._key = importer(name)(path, self.target.settings), (name, path)
        return self._open

    def _import(self, task: Task) -> Imported | Failed:
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # what it leads to is refused
                return import_one(lambda: self._source(task.format, task.path), task, self.target)
        except InputError as error:
            return Failed(task.source, str(error))
        except Exception as error:  # noqa: BLE001 — one episode must not cost the others
            bug = f"bug in the {task.format} importer ({type(error).__name__}: {error})"
            message = f"{task.source}: {bug}"
            return Failed(task.source, message)


class Reading(Closing):
    """Asks a ``Reader`` about sources, and imports episodes."""

    @abstractmethod
    def ask(self, name: str, source: Path, *arguments: Any) -> Any:
        """Call a method of ``Reader`` with a source and more arguments.

        Raises:
            InputError: the method raises or returns it.
        """

    @abstractmethod
    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, Imported | Failed]]:
        """Import episodes; yield each with its result, in whatever order."""


class Here(Reading):
    """In this process, without bounds."""

    def __init__(self, target: Target) -> None:
        """Nothing is open."""
        self._reader = Reader(target)

    def close(self) -> None:
        """Close the source that was read last."""
        self._reader.close()

    def ask(self, name: str, source: Path, *arguments: Any) -> Any:
        """See ``Reading.ask``."""
        return _raised(self._reader.answer((name, source, *arguments)))

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, Imported | Failed]]:
        """See ``Reading.run``; in the order of the tasks."""
        for task in tasks:
            yield task, self._reader.answer(task)


class Apart(Reading):
    """In spawned processes: whatever a library does over a source, the other sources are read."""

    def __init__(self, target: Target, limits: Limits, jobs: int) -> None:
        """Nothing is started yet."""
        self._limits = limits
        self._children = Children(jobs, _opened, target, memory=limits.memory)

    def close(self) -> None:
        """End the processes; what they were writing is put away."""
        self._children.close()

    def ask(self, name: str, source: Path, *arguments: Any) -> Any:
        """See ``Reading.ask``."""
        question = Question((name, source, *arguments), self._limits.seconds(source))
        answer = self._children.ask(question)
        if isinstance(answer, Ended):
            raise SourceError(str(source), f"cannot be read: looking at it {answer.why}.")
        return _raised(answer)

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, Imported | Failed]]:
        """See ``Reading.run``."""
        in_a_row: Counter[Path] = Counter()
        skipped: list[Task] = []

        def questions() -> Iterator[Question]:
            for task in tasks:
                if in_a_row[task.path] >= GIVEN_UP:
                    skipped.append(task)
                else:
                    yield Question(task, self._limits.seconds(task.path))

        for question, answer in self._children.run(questions()):
            task = question.what
            if not isinstance(answer, Ended):
                in_a_row[task.path] = 0
                yield task, answer
                continue
            in_a_row[task.path] += 1
            why = f"importing it {answer.why}" if answer.bound else answer.why
            yield task, Failed(task.source, f"{task.source}: {why}")
        why = f"not tried, as {GIVEN_UP} episodes of this source in a row came to no end"
        for task in skipped:
            yield task, Failed(task.source, f"{task.source}: {why}")


def _opened(target: Target) -> Callable[[Any], Any]:
    """Answer questions in a process of its own, with all importers loaded."""
    importers()
    reader = Reader(target)

    def answer(question: Any) -> Any:
        try:
            return reader.answer(question)
        except Exception as error:  # noqa: BLE001 — one source must not cost the others
            place, last = question[1], question[-1]
            place = last.source if isinstance(last, Task) else place
            return SourceError(str(place), f"cannot be read: {type(error).__name__}: {error}.")

    return answer


def _raised(answer: Any) -> Any:
    """Return an answer, or raise it where it is an error."""
    if isinstance(answer, InputError):
        raise answer
    return answer
