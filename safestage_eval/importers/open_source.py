"""Questions about sources, answered in whatever process; the source that was read last stays open."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError

from .import_episode import Failed, Imported, Target, Task, fingerprint_of, import_one
from .importer import Importer, SourceError
from .registry import asked, claimed, importer, nothing_known


@dataclass(frozen=True)
class Look:
    """The format of a file or folder with the reason; None if unknown."""

    path: Path
    only: str | None


@dataclass(frozen=True)
class Unknown:
    """A SourceError that says why no format matches."""

    path: Path
    only: str | None


@dataclass(frozen=True)
class Names:
    """The episodes of a source, in order."""

    format: str
    path: Path


@dataclass(frozen=True)
class Fingerprint:
    """Digest of a task's data, and of the settings that they are read with."""

    task: Task


class Shelf:
    """Answers; the next episode of an open source is likely to come."""

    def __init__(self, target: Target) -> None:
        """Nothing is open."""
        self.target = target
        self._key: tuple[str, Path] | None = None
        self._open: Importer | None = None

    def answer(self, question: Any) -> Any:
        """The answer; what is wrong with a source is one, as an InputError."""
        if isinstance(question, Task):
            return self._import(question)
        try:
            match question:
                case Look(path, only):
                    return _whose(path, only)
                case Unknown(path, only):
                    return nothing_known(path, only)
                case Names(format, path):
                    return list(self._source(format, path).episodes())
                case Fingerprint(task):
                    source = self._source(task.format, task.path)
                    return fingerprint_of(source, task.name, self.target)
        except InputError as error:
            return error
        raise TypeError(type(question))

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
            return import_one(lambda: self._source(task.format, task.path), task, self.target)
        except InputError as error:
            return Failed(task.source, str(error))
        except Exception as error:  # noqa: BLE001 — one episode must not cost the others
            what = f"{task.source}: cannot be imported: {type(error).__name__}: {error}"
            return Failed(task.source, what)


def _whose(path: Path, only: str | None) -> tuple[str, str] | None:
    found = claimed(path, asked(only))
    if found is None:
        return None
    kind, reason = found
    if isinstance(kind, SourceError):
        raise kind
    return kind.name, reason
