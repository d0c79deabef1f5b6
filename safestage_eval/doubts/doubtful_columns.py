"""Columns that contradict others are made unknown before an episode is judged.

Which columns a contradiction makes doubtful stands beside the check that finds it
(``ContradictionError.hides``). NaN and None stand for what was not measured, so that everything
downstream treats a doubtful column as one that was not recorded.
"""

from __future__ import annotations

import re
from collections import ChainMap, Counter
from collections.abc import Iterable, Sequence
from dataclasses import fields, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body
from safestage_eval.episode.contacts import ContactTable, Pair
from safestage_eval.episode.contradiction import Column, ContradictionError
from safestage_eval.episode.episode import Episode
from safestage_eval.episode.frames import RobotFrames
from safestage_eval.episode.track import Track

NOT_USED = "not used: "
"""How the note on doubtful columns begins."""

WORDS: dict[Column, str] = {
    "position": "poses",
    "orientation": "poses",
    "linear_velocity": "velocities",
    "angular_velocity": "velocities",
    "contacts": "contacts",
    "peak_force": "peak forces",
    "joint": "joint positions",
    "gripper": "gripper opening",
    "mass": "mass",
    "inertia": "inertia",
    "cavity": "cavity",
    "tcp": "tool centre point",
    "success": "success",
}
"""Column → how it is called."""


def hide_doubtful(episode: Episode, found: Iterable[ContradictionError]) -> Episode:
    """Return the episode with what the contradictions hide unknown, over all frames."""
    errors = list(found)

    def hidden(column: str) -> set[str]:
        return {name for one in errors if column in one.hides for name in one.bodies}

    def bodies() -> tuple[Body, ...]:
        gone = {field: hidden(field) for field in ("mass", "inertia", "cavity", "tcp")}
        out = []
        for body in episode.header.bodies:
            said: dict[str, object] = {
                field: None for field, names in gone.items() if body.name in names
            }
            if "cavity" in said:
                said["untold"] = (*body.untold, "cavity")
            out.append(body.model_copy(update=said) if said else body)
        return tuple(out)

    def tracks() -> dict[str, Track]:
        gone = {column.name: hidden(column.name) for column in fields(Track)}
        return {
            name: Track(
                *(
                    np.full_like(values, np.nan) if name in gone[column] else values
                    for column, values in episode.tracks[name].columns.items()
                )
            )
            for name in set().union(*gone.values()) & {*episode.tracks}
        }

    def frames() -> RobotFrames:
        own, names = episode.frames, hidden("joint")
        off = [i for i, joint in enumerate(episode.header.joints) if joint.name in names]
        if any("gripper" in one.hides for one in errors):
            own = replace(own, gripper=np.full_like(own.gripper, np.nan))
        return replace(
            own,
            joint_position=_without(own.joint_position, off),
            joint_velocity=_without(own.joint_velocity, off),
        )

    ending: dict[str, object] = {}
    if any("success" in one.hides for one in errors):
        ending = {"success": None, "success_time": None}
        if episode.header.termination == "success":
            ending["termination"] = None
    return replace(
        episode,
        header=episode.header.model_copy(update={"bodies": bodies(), **ending}),
        tracks=ChainMap(tracks(), episode.tracks),  # type: ignore[arg-type] # nothing is written
        _contacts=lambda: _contacts(episode, errors),
        _frames=frames,
        doubtful=frozenset((name, c) for one in errors for c in one.hides for name in one.bodies),
    )


def describe_doubtful(found: Sequence[ContradictionError]) -> list[str]:
    """Notes for the reader of verdicts: which columns are not used, and why; one for each kind."""
    many = Counter((one.code, one.hides) for one in found)
    told = []
    for one in found:
        alike = many.pop((one.code, one.hides), 0) - 1
        if alike < 0:
            continue
        columns = " and ".join(dict.fromkeys(WORDS[column] for column in one.hides))
        whose = f" of {' and '.join(one.bodies)}" if one.bodies else ""
        more = f" (and {alike} more alike)" if alike else ""
        fix = f"; {one.fix}" if one.fix else ""
        told.append(f"{NOT_USED}{columns}{whose}{more}, because {one.what.rstrip('.')}{fix}")
    return told


def doubtful_columns(notes: Iterable[str]) -> tuple[str, ...]:
    """Columns that the notes on an episode call not used, such as ``contacts`` or ``poses``."""
    said = [
        column
        for note in notes
        if note.startswith(NOT_USED)
        for column in re.split(r" of |, because| \(and", note[len(NOT_USED) :])[0].split(" and ")
    ]
    return tuple(dict.fromkeys(said))


def _without(values: NDArray[np.float32], columns: Sequence[int]) -> NDArray[np.float32]:
    values = values.copy()
    values[:, [i for i in columns if i < values.shape[1]]] = np.nan
    return values


def _contacts(episode: Episode, errors: Sequence[ContradictionError]) -> ContactTable:
    """The contacts with an unknown force at every frame of doubtful pairs, and unknown peaks.

    Whether two such bodies touch is not known at frames without a contact either: those may have been
    counted from another frame.
    """
    table, index, frames = episode.contacts, episode.body_index, len(episode)
    first = {body: at for at, body in reversed([*enumerate(episode.geom_owner.tolist())])}
    keep, peaks = np.ones(len(table), np.bool_), table.peak_force.copy()
    gone: set[Pair] = set()
    for one in errors:
        ids = [index[name] for name in one.bodies if name in index]
        if "contacts" in one.hides:
            gone |= {
                pair
                for pair in combinations(sorted(first), 2)
                if pair == tuple(sorted(ids)) or (len(ids) == 1 and ids[0] in pair)
            }
        if "peak_force" in one.hides:
            peaks[np.isin(table.body1, ids) & np.isin(table.body2, ids)] = np.nan
    for a, b in gone:
        keep &= ~((table.body1 == a) & (table.body2 == b))
    pairs = np.array(sorted(gone), np.int64).reshape(-1, 2)
    kept = {column.name: getattr(table, column.name) for column in fields(ContactTable)}
    new = frames * len(pairs)
    vector, scalar = np.full((new, 3), np.nan), np.full(new, np.nan)
    sides = [np.repeat(pairs[:, side], frames) for side in (0, 1)]
    geoms = [np.array([first[int(body)] for body in side], np.int64) for side in sides]
    added = (np.tile(np.arange(frames), len(pairs)), *sides, *geoms,
             vector, vector, vector, scalar, scalar)  # fmt: skip
    return ContactTable.build(
        *(
            np.concatenate([(kept | {"peak_force": peaks})[column.name][keep], more])
            for column, more in zip(fields(ContactTable), added, strict=True)
        )
    )
