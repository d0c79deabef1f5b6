"""Import all episodes of a source into a dataset; may be repeated, and no episode is written by halves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from dataclasses import replace as with_
from pathlib import Path

from safestage_eval.errors import InputError, readable
from safestage_eval.formats import EpisodeRef, discover

from .bind_headers import Bound
from .import_episode import Failed, Imported, Target, Task
from .importer import Settings, SourceError
from .missing_data import unused_entries
from .read_source import Apart, Here, Limits, Reading


@dataclass(frozen=True)
class Outcome:
    """The result of importing a source.

    Attributes:
        formats: file or folder → (format, by what it was recognised).
        imported, failed: in the order of the source.
        unused: entries of the map file that name nothing in any episode, as messages.
    """

    formats: dict[str, tuple[str, str]]
    imported: tuple[Imported, ...]
    failed: tuple[Failed, ...]
    unused: tuple[str, ...] = ()


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
    replace: bool = False,
    limits: Limits | None = None,
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
        limit: import the first ``limit`` episodes only.
        jobs: worker processes.
        mcap: write MCAP files.
        replace: import again what is there already from other data or with other settings.
        limits: what each look and each episode may take; they are then read in processes of their own,
            as they are with more than one job. Without it nothing is bounded.
        progress: called with (done, total) after each episode.

    Raises:
        SourceError: nothing was recognised, or the map file names no episode of the source.
    """
    settings = settings or Settings()
    target = Target(to, mcap, settings, bind)
    apart = limits is not None or jobs > 1
    with Apart(target, limits or Limits(), jobs) if apart else Here(target) as reading:
        tasks, failed, formats = _tasks(source, to, reading, only, prefix)
        if tasks:
            _episodes_exist(settings, {task.name for task in tasks})
        tasks = tasks[:limit]
        there = _there(to)
        imported: dict[str, Imported] = {}
        todo = []
        for task in tasks:
            if task.episode_id not in there:
                todo.append(task)
                continue
            try:
                imported[task.source] = _kept(task, target, there[task.episode_id], reading)
            except InputError as error:
                if replace:
                    todo.append(with_(task, replaces=there[task.episode_id].stored_in))
                else:
                    failed.append(Failed(task.source, str(error)))
        for done, (task, result) in enumerate(reading.run(todo), len(tasks) - len(todo) + 1):
            if isinstance(result, Imported):
                imported[task.source] = result
            else:
                failed.append(result)
            if progress is not None:
                progress(done, len(tasks))
    order = {task.source: i for i, task in enumerate(tasks)}
    return Outcome(
        formats,
        tuple(imported[task.source] for task in tasks if task.source in imported),
        tuple(sorted(failed, key=lambda f: order.get(f.source, -1))),
        tuple(unused_entries({n for one in imported.values() for n in one.bodies}, settings.map))
        if imported
        else (),
    )


def _tasks(
    source: Path, to: Path, reading: Reading, only: str | None, prefix: str
) -> tuple[list[Task], list[Failed], dict[str, tuple[str, str]]]:
    tasks: list[Task] = []
    failed: list[Failed] = []
    formats: dict[str, tuple[str, str]] = {}
    root = source.resolve().parent

    if not source.exists():
        raise SourceError(str(source), "no such file or folder", fix="check the spelling")
    recognised = list(recognised_in(source, to.resolve(), reading, only))
    if not recognised:
        reading.ask("unrecognised", source, only)
    for path, kind in recognised:
        place = readable(path.resolve().relative_to(root).as_posix())
        try:
            if isinstance(kind, InputError):
                raise kind
            formats[str(path)] = kind
            names: list[str] = reading.ask("episodes", path, kind[0])
        except InputError as error:
            if len(recognised) == 1:
                raise
            failed.append(Failed(place, str(error)))
            continue
        stem = place.removesuffix(readable(path.suffix)) if path.is_file() else place
        tasks += [
            Task(kind[0], path, name, f"{prefix}{stem}/{name}", f"{place}:{name}") for name in names
        ]
    return tasks, failed, formats


def recognised_in(
    source: Path, but: Path, reading: Reading, only: str | None
) -> Iterator[tuple[Path, tuple[str, str] | InputError]]:
    """Yield each file or folder of a known format, and nothing below it; skip the folder ``but``.

    Yields:
        (path, (format, reason)), or the error of one that cannot be examined.
    """
    if source.resolve() == but:
        return
    try:
        kind: tuple[str, str] | InputError | None = reading.ask("format", source, only)
    except InputError as error:
        kind = error
    if kind is not None:
        yield source, kind
    elif source.is_dir():
        for path in sorted(source.iterdir()):
            if not path.name.startswith("."):
                yield from recognised_in(path, but, reading, only)


def _episodes_exist(settings: Settings, names: set[str]) -> None:
    """Raise SourceError when the map file names episodes that the source does not have."""
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


def _kept(task: Task, target: Target, ref: EpisodeRef, reading: Reading) -> Imported:
    """The episode that is there already, if it came from the same data with the same settings.

    Raises:
        InputError: it is another one.
    """
    there = ref.open().header
    if there.source.fingerprint != reading.ask("fingerprint", task.path, task):
        raise InputError(
            str(target.folder),
            f"holds another episode {task.episode_id!r}, from other data or imported with "
            "another map or other flags.",
            fix="--replace to take its place; or another --to, or --prefix TEXT for another id",
        )
    bodies = tuple(body.name for body in there.bodies)
    return Imported(
        task.episode_id, task.source, ref.shown, 0, there.source.account, new=False, bodies=bodies
    )
