"""Reading of sources in this process, or in child processes that may hang, grow or die."""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from safestage_eval._process.children import Children, Ended, Question
from safestage_eval._process.closing import Closing
from safestage_eval.errors import InputError

from .import_episode import Failed, Imported, Target, Task
from .import_limits import Limits
from .importer import SourceError
from .open_source import Shelf
from .registry import importers

GIVEN_UP = 3
"""Episodes of a source in a row that end their process or pass its bounds; the rest is not tried."""


class Reading(Closing):
    """Answers questions about sources (``open_source``), and imports episodes."""

    @abstractmethod
    def ask(self, question: Any, source: Path) -> Any:
        """The answer to a question about a source. Raises InputError if that is the answer."""

    @abstractmethod
    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, Imported | Failed]]:
        """Each episode with what became of it, in whatever order."""


class Here(Reading):
    """In this process, without bounds."""

    def __init__(self, target: Target) -> None:
        """Nothing is open."""
        self._shelf = Shelf(target)

    def close(self) -> None:
        """Close the source that was read last."""
        self._shelf.close()

    def ask(self, question: Any, source: Path) -> Any:  # noqa: ARG002
        """See ``Reading.ask``."""
        return _given(self._shelf.answer(question))

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, Imported | Failed]]:
        """See ``Reading.run``; in the order of the tasks."""
        for task in tasks:
            yield task, self._shelf.answer(task)


class Apart(Reading):
    """In spawned processes: whatever a library does over a source, the other sources are read."""

    def __init__(self, target: Target, limits: Limits, jobs: int) -> None:
        """Nothing is started yet."""
        self._limits = limits
        self._children = Children(jobs, _opened, target, memory=limits.memory)

    def close(self) -> None:
        """End the processes; what they were writing is put away."""
        self._children.close()

    def ask(self, question: Any, source: Path) -> Any:
        """See ``Reading.ask``."""
        answer = self._children.ask(Question(question, self._limits.seconds(source)))
        if isinstance(answer, Ended):
            raise SourceError(str(source), f"cannot be read: looking at it {answer.why}.")
        return _given(answer)

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
    shelf = Shelf(target)

    def answer(question: Any) -> Any:
        try:
            return shelf.answer(question)
        except Exception as error:  # noqa: BLE001 — one source must not cost the others
            place = getattr(question, "path", None) or question.task.source
            return SourceError(str(place), f"cannot be read: {type(error).__name__}: {error}.")

    return answer


def _given(answer: Any) -> Any:
    """The answer; raised when it is an error."""
    if isinstance(answer, InputError):
        raise answer
    return answer
