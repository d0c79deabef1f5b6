"""Import one episode: read it, add its source and account, write it whole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

from safestage_eval.episode import Header, Remark
from safestage_eval.formats import save
from safestage_eval.formats.parquet.dataset_writer import remove_episode
from safestage_eval.formats.save import mcap_name

from .account import Account
from .bind_headers import Bound
from .importer import Importer, Settings
from .map_mistakes import Notice, notice
from .map_tables import MapFile
from .noisy_velocities import believe_poses
from .scene_bodies import in_metres


@dataclass(frozen=True)
class Task:
    """One episode to import; small and picklable.

    Attributes:
        format: the importer's name.
        path: its file or folder.
        name: of the episode in there.
        episode_id: it gets this one.
        source: of it, as the header will say.
        replaces: name of the files of a dataset that hold it, and that it takes the place of.
    """

    format: str
    path: Path
    name: str
    episode_id: str
    source: str
    replaces: str | None = None


@dataclass(frozen=True)
class Target:
    """Destination and settings of an import; picklable.

    Attributes:
        folder: of the dataset, or of the MCAP files.
        mcap: one MCAP file per episode instead of a dataset.
        settings: what the user adds to the source.
        bind: roles, goal, rules and values for the headers.
    """

    folder: Path
    mcap: bool
    settings: Settings
    bind: Bound | None = None


@dataclass(frozen=True)
class Imported:
    """One episode that is in the target now.

    Attributes:
        episode_id, source: as in its header.
        path: the file of ``meta/episodes``, or the MCAP file.
        frames: T; 0 of one that was there already.
        account: what was missing, recomputed or guessed.
        new: it was not there before.
        notices: what cannot be right in it, with the likely mistake.
        bodies: their names.
    """

    episode_id: str
    source: str
    path: str
    frames: int
    account: tuple[Remark, ...]
    new: bool = True
    notices: tuple[Notice, ...] = ()
    bodies: tuple[str, ...] = ()


@dataclass(frozen=True)
class Failed:
    """One episode, or one file, that could not be imported."""

    source: str
    message: str


def import_one(open_importer: Callable[[], Importer], task: Task, target: Target) -> Imported:
    """Read one episode and write it, whole or not at all.

    Raises:
        InputError: it cannot be imported, or what came out breaks an invariant of traces.
    """
    source = open_importer()
    source.settings = replace(
        target.settings, map=target.settings.map.within(f"{task.source} {task.name}")
    )
    account = Account()
    episode = source.read(task.name, account)
    episode = believe_poses(episode, source.settings.map, account)
    fingerprint = fingerprint_of(source, task.name, target)
    header = _stamped(episode.header, task, fingerprint, account, target, source.settings.map)
    ready = replace(episode, header=header, _contacts=episode.contacts, _frames=episode.frames)
    ready = in_metres(ready, source.settings.map)
    notices = notice(ready, source.settings.map)
    path = target.folder / mcap_name(task.episode_id) if target.mcap else target.folder
    ref = save(ready, path, "mcap" if target.mcap else "parquet")
    if task.replaces is not None:
        remove_episode(target.folder, task.replaces)
    return Imported(
        task.episode_id,
        task.source,
        ref.shown,
        len(ready),
        header.source.account,
        notices=notices,
        bodies=tuple(body.name for body in header.bodies),
    )


def _stamped(
    header: Header, task: Task, fingerprint: str, account: Account, target: Target, map_: MapFile
) -> Header:
    """The header with its id, its source, and what map and bind file say."""
    from safestage_eval.version import __version__

    source = header.source.model_copy(
        update={
            "recorder": f"safestage import ({task.format})",
            "recorder_version": __version__,
            "episode": task.source,
            "fingerprint": fingerprint,
            "account": account.remarks,
        }
    )
    header = header.model_copy(update={"episode_id": task.episode_id, "source": source})
    header = map_.header(header, task.name)
    return header if target.bind is None else target.bind.onto(header, task.name)


def fingerprint_of(source: Importer, name: str, target: Target) -> str:
    """Return the digest of the data, and of the settings that they were read with."""
    settings = target.settings
    with_ = f"{settings.map.digest} {settings.quaternion} {settings.dt}"
    with_ += "".join(f" {path}" for path in (settings.python, settings.robot) if path is not None)
    return sha256(f"{source.fingerprint(name)} {with_}".encode()).hexdigest()[:16]
