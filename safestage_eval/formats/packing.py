"""Merging episodes into shards: few large files instead of many small ones, for publishing."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from safestage_eval.episode import Episode, check
from safestage_eval.errors import InputError, TraceError

from .atomic import PART
from .discover import discover
from .episode_ref import EpisodeRef
from .parquet import dataset_layout as layout
from .parquet.dataset_reader import open_episode
from .parquet.dataset_writer import next_index, writing_shard
from .save import short_name

SHARD_EPISODES = 100
"""Episodes per shard: a task's rollouts of a policy under three seeds and prompts, as a rule."""

_ORDER = ("policy", "task", "prompt", "seed", "rollout")


@dataclass
class Packed:
    """The result of packing.

    Attributes:
        packed: id → file of ``meta/episodes`` that holds it now.
        there: ids that the dataset held already, with the same content.
        problems: (where, why) of those left out.
    """

    packed: dict[str, Path] = field(default_factory=dict)
    there: list[str] = field(default_factory=list)
    problems: list[tuple[str, str]] = field(default_factory=list)


def pack(
    refs: Sequence[EpisodeRef],
    out: Path,
    *,
    by: Sequence[str] = ("policy", "task"),
    shard_episodes: int = SHARD_EPISODES,
    progress: Callable[[int, int], None] | None = None,
) -> Packed:
    """Copy episodes into shards of a dataset, one or more for each group of episodes.

    Nothing is lost or changed: each copy is read back and its content compared by hash. The
    sources stay as they are. Episodes that the dataset holds already are skipped, so a run that
    was stopped goes on where it was. A broken episode is left out and listed.

    Args:
        refs: the episodes, in any order.
        out: an empty or new folder, or a dataset that was packed before.
        by: header fields that make a group; their values name its files.
        shard_episodes: most episodes in one shard.
        progress: called with (done, all) after each episode.

    Raises:
        TraceError: the folder holds something else, or is being packed by another process.
    """
    result = Packed()
    with _alone_in(out):
        hashes = _there(out)
        groups, index = _groups(refs, by), next_index(out)
        done, total = 0, len(refs)
        for name, group in groups.items():
            todo = []
            for ref in group:
                if _is_new(ref, hashes, result):
                    todo.append(ref)
                else:
                    done += 1
            for begin in range(0, len(todo), shard_episodes):
                part = todo[begin : begin + shard_episodes]
                file = _free_name(out, name)
                for _ in _write_shard(part, out, file, index, result):
                    done += 1
                    if progress is not None:
                        progress(done, total)
                index += len(part)
    return result


def _write_shard(
    refs: Sequence[EpisodeRef], out: Path, file: str, first: int, result: Packed
) -> Iterator[EpisodeRef]:
    """Write a shard and read it back, episode by episode."""
    written: list[tuple[str, str]] = []
    folder = out / layout.EPISODES
    with writing_shard(out, file, first) as shard:
        for ref in refs:
            where = ref.episode_id or ref.shown
            try:
                episode = _sound(ref)
                shard.add(episode)
                written.append((where, episode.content_hash))
            except InputError as problem:
                result.problems.append((where, str(problem)))
            yield ref
    entry = folder / f"{file}.parquet"
    for index, (name, content_hash) in enumerate(written, first):
        if open_episode(entry, index).content_hash != content_hash:
            raise TraceError(str(entry), f"the copy of {name} differs from its source.")
        result.packed[name] = entry


def _sound(ref: EpisodeRef) -> Episode:
    """Open an episode and compare it with its stated hash. Raises TraceError where it is damaged."""
    episode = ref.open()
    problems = check(episode)
    if problems:
        raise problems[0]
    if ref.content_hash not in (None, episode.content_hash):
        raise TraceError(
            ref.shown,
            "its content is not what its content_hash says: it was damaged or edited.",
            fix="safestage audit --files says more; convert makes a copy with the right hash",
        )
    return episode


def _is_new(ref: EpisodeRef, hashes: dict[str, str | None], result: Packed) -> bool:
    """True if an episode is not in the dataset yet; notes it. A second content under one id is a problem."""
    name = ref.episode_id
    if ref.problem is not None:
        result.problems.append((name or ref.shown, str(ref.problem)))
        return False
    if name not in hashes:
        hashes[name] = ref.content_hash
        return True
    if hashes[name] == ref.content_hash:
        result.there.append(name)
    else:
        result.problems.append((name, f"{ref.shown}: another episode with this id is packed"))
    return False


def _groups(refs: Sequence[EpisodeRef], by: Sequence[str]) -> dict[str, list[EpisodeRef]]:
    """File name → its episodes, both in order."""

    def place(ref: EpisodeRef) -> tuple[Any, ...]:
        return *(str(ref.fields.get(name)) for name in by), *_sortable(ref), ref.episode_id

    groups: dict[str, list[EpisodeRef]] = {}
    for ref in sorted(refs, key=place):
        values = [ref.fields.get(name) for name in by]
        plain = [re.sub(r"[^\w.+=@-]+", "-", str(v)).strip("-.") for v in values if v is not None]
        groups.setdefault(short_name("_".join(filter(None, plain)) or "episodes"), []).append(ref)
    return groups


def _sortable(ref: EpisodeRef) -> Iterator[Any]:
    for name in _ORDER:
        value = ref.fields.get(name)
        yield (value is None, str(value).zfill(9) if isinstance(value, int) else str(value))


def _free_name(out: Path, name: str) -> str:
    taken = {path.stem for path in (out / layout.EPISODES).glob("*.parquet")}
    number = 0
    while f"{name}-{number:03d}" in taken:
        number += 1
    return f"{name}-{number:03d}"


def _there(out: Path) -> dict[str, str | None]:
    """Id → content hash of the episodes that are in the dataset already."""
    if not any((out / layout.EPISODES).glob("*.parquet")):
        return {}
    return {ref.episode_id: ref.content_hash for ref in discover(out)}


def _holds_files(folder: Path) -> bool:
    """True if a folder holds files other than those that a killed run was writing."""
    return any(path.is_file() and not path.name.endswith(PART) for path in folder.rglob("*"))


@contextmanager
def _alone_in(out: Path) -> Iterator[None]:
    """Lock the folder against other processes that pack into it; the lock ends with the process."""
    if not layout.is_dataset(out) and _holds_files(out):
        raise TraceError(
            str(out), "holds something that is no dataset.", fix="give a new or an empty folder"
        )
    layout.prepare(out)
    path = out / "meta" / ".pack.lock"
    with path.open("w") as lock:
        if not _claimed(lock.fileno(), path):
            raise TraceError(str(out), "is being packed by another process.", fix="wait for it")
        yield
        path.unlink(missing_ok=True)


def _claimed(handle: int, path: Path) -> bool:
    """True if this process alone has locked the open file, and the file is still the one of that name."""
    if os.name == "nt":  # no such locks there
        return True
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return os.fstat(handle).st_ino == path.stat().st_ino
    except OSError:
        return False
