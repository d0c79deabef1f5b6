"""Importing all episodes of a source into a dataset: again and again, and none by halves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef, discover

from .bound import Bound
from .importer import Settings, SourceError
from .one import Failed, Imported, Target, Task, fingerprint_of
from .pool import run_all
from .registry import importer, recognised


@dataclass(frozen=True)
class Outcome:
    """What importing came to.

    Attributes:
        formats: file or folder → (format, by what it was recognised).
        imported, failed: in the order of the source.
    """

    formats: dict[str, tuple[str, str]]
    imported: tuple[Imported, ...]
    failed: tuple[Failed, ...]


def import_all(
    source: Path,
    to: Path,
    settings: Settings | None = None,
    *,
    only: str | None = None,
    bind: Bound | None = None,
    prefix: str = "",
    limit: int | None = None,
    jobs: int = 1,
    mcap: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Outcome:
    """Import what an importer recognises under a path; an episode that is there already is kept.

    Args:
        source: a file or folder.
        to: a dataset's folder, or with ``mcap`` a folder of MCAP files.
        settings: what the user adds to the source.
        only: the format to take it for, instead of asking all.
        bind: roles, goal, rules and values (docs/rules.md) to put into the headers.
        prefix: of the episode ids, to keep apart sources whose names are the same.
        limit: import the first so many.
        jobs: worker processes.
        mcap: write MCAP files.
        progress: told (done, total) after each episode.

    Raises:
        SourceError: nothing was recognised, or the map file speaks of no episode of the source.
    """
    settings = settings or Settings()
    tasks, failed, formats = _tasks(source, to, settings, only, prefix)
    if tasks:
        _episodes_exist(settings, {task.name for task in tasks})
    tasks = tasks[:limit]
    there = _there(to)
    target = Target(to, mcap, settings, bind)
    imported: dict[str, Imported] = {}
    todo = []
    for task in tasks:
        if task.episode_id not in there:
            todo.append(task)
            continue
        try:
            imported[task.source] = _kept(task, target, there[task.episode_id])
        except InputError as error:
            failed.append(Failed(task.source, str(error)))
    done = count(len(tasks) - len(todo) + 1)

    def note(task: Task, result: Imported | Failed) -> None:
        if isinstance(result, Imported):
            imported[task.source] = result
        else:
            failed.append(result)
        if progress is not None:
            progress(next(done), len(tasks))

    run_all(todo, target, jobs, note)
    order = {task.source: i for i, task in enumerate(tasks)}
    return Outcome(
        formats,
        tuple(imported[task.source] for task in tasks if task.source in imported),
        tuple(sorted(failed, key=lambda f: order.get(f.source, -1))),
    )


def _tasks(
    source: Path, to: Path, settings: Settings, only: str | None, prefix: str
) -> tuple[list[Task], list[Failed], dict[str, tuple[str, str]]]:
    tasks: list[Task] = []
    failed: list[Failed] = []
    formats: dict[str, tuple[str, str]] = {}
    root = source.resolve().parent
    found = recognised(source, only, to)
    for path, kind, reason in found:
        place = path.resolve().relative_to(root).as_posix()
        try:
            if isinstance(kind, SourceError):
                raise kind
            formats[str(path)] = (kind.name, reason)
            opened = kind(path, settings)
            names = opened.episodes()
            opened.close()
        except InputError as error:
            if len(found) == 1:
                raise
            failed.append(Failed(place, str(error)))
            continue
        stem = place.removesuffix(path.suffix) if path.is_file() else place
        tasks += [
            Task(kind.name, path, name, f"{prefix}{stem}/{name}", f"{place}:{name}")
            for name in names
        ]
    return tasks, failed, formats


def _episodes_exist(settings: Settings, names: set[str]) -> None:
    """Raises SourceError when the map file speaks of episodes that the source does not have."""
    unknown = sorted(set(settings.map.episode) - names)
    if unknown:
        some = ", ".join(sorted(names)[:6])
        raise SourceError(
            settings.map.path, f"[episode.{unknown[0]}] names no episode of the source.", some
        )


def _there(folder: Path) -> dict[str, EpisodeRef]:
    """Id → where it is, of the episodes that the target has already."""
    if not folder.is_dir():
        return {}
    return {ref.episode_id: ref for ref in discover([folder], maybe_none=True)}


def _kept(task: Task, target: Target, ref: EpisodeRef) -> Imported:
    """The episode that is there already, if it came from the same data with the same settings.

    Raises:
        InputError: it is another one.
    """
    there = ref.open().header
    source = importer(task.format)(task.path, target.settings)
    same = there.source.fingerprint == fingerprint_of(source, task.name, target)
    source.close()
    if not same:
        raise InputError(
            str(target.folder),
            f"holds another episode {task.episode_id!r}, from other data or imported with "
            "another map or other flags.",
            fix="another --to, or --prefix TEXT for another id",
        )
    return Imported(task.episode_id, task.source, str(ref.path), 0, there.source.account, new=False)
