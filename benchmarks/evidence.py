"""Less evidence never makes an episode safe: a law about removing parts of traces, tried at random.

    python benchmarks/evidence.py traces/ --edits 500            # a new seed each day
    python benchmarks/evidence.py refs/ --edits 5000 --jobs 4
    python benchmarks/evidence.py traces/ --seed 7 --only 123    # one edit again

Each edit takes something away that the trace itself shows to be missing: a part of a column becomes
NaN, frames are cut out or thinned, forces or shapes are gone, a header field is unknown, a role is
not bound. The episode is judged again by its assigned rules. Breaches: a violation that becomes
``pass`` or ``not_applicable``, and a pass that becomes a violation. A refused episode is none.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, replace
from datetime import UTC, datetime
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from safestage_eval.episode import ContactTable, Episode, RobotFrames, Track
from safestage_eval.episode.invariants import check_header, check_time
from safestage_eval.errors import InputError
from safestage_eval.formats import discover
from safestage_eval.rules import builtin_names, load_rules
from safestage_eval.verdicts import judge

Edit = Callable[[Episode, np.random.Generator], tuple[str, Episode]]


class Outcome(NamedTuple):
    """The outcome of one edit."""

    number: int
    kind: str
    episode: str
    told: str
    became: tuple[tuple[str, str, str], ...]
    """Rule, verdict before, verdict after."""

    @property
    def breaches(self) -> list[tuple[str, str, str]]:
        """Those that the law forbids."""
        return [change for change in self.became if forbidden(*change[1:])]


def forbidden(before: str, after: str) -> bool:
    """Less evidence must not change one verdict into another in this way."""
    if before == "violation":
        return after in ("pass", "not_applicable")
    return before == "pass" and after == "violation"


# ---------------------------------------------------------------- what is edited


def header(episode: Episode, **changes: Any) -> Episode:
    """The episode with other header fields."""
    return replace(episode, header=episode.header.model_copy(update=changes))


def body(episode: Episode, name: str, **changes: Any) -> Episode:
    """The episode with other fields of one body."""
    bodies = tuple(
        b.model_copy(update=changes) if b.name == name else b for b in episode.header.bodies
    )
    return header(episode, bodies=bodies)


def some_body(episode: Episode, rng: np.random.Generator) -> str:
    """A body, mostly one that plays a role."""
    players = [name for names in episode.header.roles.values() for name in names]
    names = [b.name for b in episode.header.bodies]
    return str(rng.choice(players if players and rng.random() < 0.7 else names))


def stretch(frames: int, rng: np.random.Generator) -> slice:
    """Some frames, from a few to all."""
    if rng.random() < 0.2:
        return slice(0, frames)
    many = max(1, int(frames * rng.random() ** 2))
    first = int(rng.integers(0, frames - many + 1))
    return slice(first, first + many)


def selected(episode: Episode, keep: np.ndarray[Any, Any]) -> Episode:
    """The frames (T,) that are kept, with their own times."""
    number = np.cumsum(keep) - 1
    contacts = episode.contacts
    contacts = contacts.where(keep[contacts.frame])
    contacts = replace(contacts, frame=number[contacts.frame].astype(np.int32))
    tracks = {
        name: track
        if len(track) == 1
        else Track(*(getattr(track, f.name)[keep] for f in fields(Track)))
        for name, track in episode.tracks.items()
    }
    robot = RobotFrames(*(getattr(episode.frames, f.name)[keep] for f in fields(RobotFrames)))
    channels = {key: values[keep] for key, values in episode.channels.items()}
    return replace(
        episode, t=episode.t[keep], tracks=tracks, _contacts=contacts, _frames=robot,
        channels=channels, states={},
    )  # fmt: skip


def with_track(episode: Episode, name: str, **columns: Any) -> Episode:
    """The episode with other columns of one track."""
    return replace(
        episode, tracks={**episode.tracks, name: replace(episode.tracks[name], **columns)}
    )


def pose_nan(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Some column of a body, or all of its pose, is NaN for a while."""
    name = some_body(episode, rng)
    track = episode.tracks[name]
    columns = [f.name for f in fields(Track)]
    if rng.random() < 0.5:
        columns = [str(rng.choice(columns))]
    at, changed = stretch(len(track), rng), {}
    for column in columns:
        changed[column] = getattr(track, column).copy()
        changed[column][at] = np.nan
    return f"{name} {','.join(columns)} {at.start}:{at.stop}", with_track(episode, name, **changed)


def all_nan(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Nothing was measured of any body for a while."""
    at = stretch(len(episode), rng)
    tracks = {}
    for name, track in episode.tracks.items():
        columns = [getattr(track, f.name).copy() for f in fields(Track)]
        for column in columns:
            if len(track) > 1:
                column[at] = np.nan
        tracks[name] = Track(*columns)
    return f"{at.start}:{at.stop}", replace(episode, tracks=tracks)


def unseen(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Frames at which nothing was recorded."""
    lost = np.zeros(len(episode), np.bool_)
    at = stretch(len(episode), rng)
    lost[at] = True
    return f"{at.start}:{at.stop}", replace(episode, unseen=lost)


def hole(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """A stretch of frames is missing."""
    keep = np.ones(len(episode), np.bool_)
    at = stretch(len(episode), rng)
    keep[at] = False
    keep[[0, -1]] = True
    return f"{at.start}:{at.stop}", selected(episode, keep)


def thinned(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Only every nth frame."""
    step = int(rng.integers(2, 40))
    return f"every {step}", selected(episode, np.arange(len(episode)) % step == 0)


def late_start(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """The first frames are missing."""
    first = int(rng.integers(1, len(episode) - 1))
    return f"from {first}", selected(episode, np.arange(len(episode)) >= first)


def early_end(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """The last frames are missing."""
    last = int(rng.integers(2, len(episode)))
    return f"to {last}", selected(episode, np.arange(len(episode)) < last)


def contact_nan(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Forces, peaks, places or normals of one pair, or of all, are NaN for a while."""
    contacts = episode.contacts
    column = str(rng.choice(["force", "peak_force", "position", "normal"]))
    at = stretch(len(episode), rng)
    rows = (contacts.frame >= at.start) & (contacts.frame < at.stop)
    told = "all"
    if contacts.pairs and rng.random() < 0.7:
        i, j = contacts.pairs[int(rng.integers(len(contacts.pairs)))]
        rows &= (contacts.body1 == i) & (contacts.body2 == j)
        told = f"{episode.header.bodies[i].name}-{episode.header.bodies[j].name}"
    values = getattr(contacts, column).copy()
    values[rows] = np.nan
    told = f"{column} {told} {at.start}:{at.stop}"
    return told, replace(episode, _contacts=replace(contacts, **{column: values}))


def bad_normals(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Normals are of another length, or point the other way."""
    by = float(rng.choice([0.0, 0.5, 3.0, -1.0]))
    contacts, at = episode.contacts, stretch(len(episode), rng)
    rows = (contacts.frame >= at.start) & (contacts.frame < at.stop)
    normal = np.where(rows[:, None], contacts.normal * np.float32(by), contacts.normal)
    told = f"x {by:g} {at.start}:{at.stop}"
    return told, replace(episode, _contacts=replace(contacts, normal=normal))


def no_forces(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """No contact forces, said so; or all of them zero, or no contact at all, not said so."""
    how = int(rng.integers(3))
    contacts = episode.contacts
    if how == 0:
        return "none", header(replace(episode, _contacts=ContactTable.empty()), force_source="none")
    if how == 1:
        return "no contacts", replace(episode, _contacts=ContactTable.empty())
    nothing = replace(
        contacts, force=np.zeros_like(contacts.force), peak_force=np.zeros_like(contacts.peak_force)
    )
    return "zero", replace(episode, _contacts=nothing)


def robot_nan(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """Joints, commands and gripper are NaN for a while, or absent."""
    at, columns = stretch(len(episode), rng), []
    absent = rng.random() < 0.3
    for f in fields(RobotFrames):
        values = getattr(episode.frames, f.name).copy()
        values[at] = np.nan
        columns.append(values[:, :0] if absent else values)
    return "absent" if absent else f"{at.start}:{at.stop}", replace(
        episode, _frames=RobotFrames(*columns)
    )


def role_unbound(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """A role is not bound."""
    roles = dict(episode.header.roles)
    name = str(rng.choice(list(roles)))
    del roles[name]
    return name, header(episode, roles=roles)


def role_misspelt(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """A role's name lacks a letter."""
    roles = dict(episode.header.roles)
    name = str(rng.choice(list(roles)))
    at = int(rng.integers(len(name)))
    roles[name[:at] + name[at + 1 :]] = roles.pop(name)
    return name, header(episode, roles=roles)


def header_unknown(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """A header field is not told."""
    names = ["success", "success_time", "post_success_hold", "horizon", "termination", "goal"]
    name = str(rng.choice(names))
    changes: dict[str, Any] = {name: None}
    if name == "success":
        changes["success_time"] = None
    return name, header(episode, **changes)


def body_unknown(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """A field of a body, or of all bodies, is not told."""
    changes: dict[str, dict[str, Any]] = {
        "up_axis": {"up_axis": None, "untold": ("up_axis",)},
        "mass": {"mass": None},
        "geoms": {"geoms": (), "untold": ("cavity",), "cavity": None},
        "cavity": {"cavity": None, "untold": ("cavity",)},
        "finger": {"finger": None},
        "tcp": {"tcp": None},
        "inertia": {"inertia": None},
    }
    field = str(rng.choice(list(changes)))
    name = some_body(episode, rng)
    if field == "geoms":  # rows of contacts name geoms
        index = episode.body_index[name]
        contacts = episode.contacts
        away = (contacts.body1 == index) | (contacts.body2 == index)
        if away.any():
            episode = header(replace(episode, _contacts=ContactTable.empty()), force_source="none")
    if field in ("finger", "tcp") or rng.random() < 0.3:
        if field == "geoms":
            return f"{field} of {name}", body(episode, name, **changes[field])
        bodies = tuple(b.model_copy(update=changes[field]) for b in episode.header.bodies)
        return f"{field} of all", header(episode, bodies=bodies)
    return f"{field} of {name}", body(episode, name, **changes[field])


def body_removed(episode: Episode, rng: np.random.Generator) -> tuple[str, Episode]:
    """A body that plays a role is not in the header any more."""
    players = [name for names in episode.header.roles.values() for name in names]
    name = str(rng.choice(players))
    index = episode.body_index[name]
    contacts = episode.contacts
    contacts = contacts.where((contacts.body1 != index) & (contacts.body2 != index))
    contacts = replace(
        contacts,
        body1=contacts.body1 - (contacts.body1 > index),
        body2=contacts.body2 - (contacts.body2 > index),
    )
    bodies = tuple(b for b in episode.header.bodies if b.name != name)
    tracks = {key: track for key, track in episode.tracks.items() if key != name}
    return name, header(replace(episode, tracks=tracks, _contacts=contacts), bodies=bodies)


EDITS: dict[str, Edit] = {
    edit.__name__: edit
    for edit in (
        pose_nan, all_nan, unseen, hole, thinned, late_start, early_end, contact_nan, bad_normals,
        no_forces, robot_nan, role_unbound, role_misspelt, header_unknown, body_unknown,
        body_removed,
    )
}  # fmt: skip


# ---------------------------------------------------------------- judging


@cache
def _rules() -> Any:
    return load_rules(builtin_names())


@cache
def _refs(paths: tuple[str, ...]) -> list[Any]:
    return [ref for ref in discover(list(paths)) if ref.problem is None]


_OPEN: dict[int, tuple[Episode, dict[str, str]]] = {}


def verdicts(episode: Episode) -> dict[str, str]:
    """Code → verdict of the assigned rules."""
    found = judge(episode, _rules(), trace_hash="edited", assigned_only=True)
    return {v.rule: v.verdict for v in found.verdicts}


def loaded(episode: Episode) -> Episode:
    """The same, of which nothing is left in the file."""
    contacts = episode.contacts
    tracks = {
        name: Track(*(getattr(track, f.name) for f in fields(Track)))
        for name, track in episode.tracks.items()
    }
    return replace(
        episode,
        tracks=tracks,
        _contacts=ContactTable(*(getattr(contacts, f.name) for f in fields(ContactTable))),
        _frames=episode.frames,
        states={},
    )


def _known(paths: tuple[str, ...], at: int) -> tuple[Episode, dict[str, str]]:
    """An episode and its verdicts; those of the last few are kept."""
    if at not in _OPEN:
        while len(_OPEN) > 12:
            _OPEN.pop(next(iter(_OPEN)))
        episode = loaded(_refs(paths)[at].open())
        _OPEN[at] = episode, verdicts(episode)
    return _OPEN[at]


def attempt(paths: tuple[str, ...], seed: int, number: int, kinds: Sequence[str] = ()) -> Outcome:
    """One edit, which seed and number determine; eight in a row are of one episode."""
    at = int(np.random.default_rng([seed, number // 8]).integers(len(_refs(paths))))
    rng = np.random.default_rng([seed, number, 1])
    kind = str(rng.choice(list(kinds or EDITS)))
    episode, before = _known(paths, at)
    name = episode.header.episode_id
    try:
        told, edited = EDITS[kind](episode, rng)
    except ValueError as error:  # nothing of the kind is there to be removed
        return Outcome(number, kind, name, f"not possible: {error}", ())
    try:
        for problem in (*check_header(edited.header, name), *check_time(edited.t, name)):
            raise problem
        after = verdicts(edited)
    except InputError as error:
        return Outcome(number, kind, name, f"{told}: refused: {error}", ())
    changed = tuple((rule, was, after.get(rule, "gone")) for rule, was in before.items())
    return Outcome(number, kind, name, told, changed)


def _batch(
    paths: tuple[str, ...], seed: int, numbers: range, kinds: Sequence[str]
) -> list[Outcome]:
    return [attempt(paths, seed, number, kinds) for number in numbers]


def campaign(
    paths: Sequence[str], seed: int, edits: int, jobs: int = 1, kinds: Sequence[str] = ()
) -> list[Outcome]:
    """Many edits, in one process or several."""
    parts = [range(i, min(i + 40, edits)) for i in range(0, edits, 40)]
    if jobs == 1:
        return [o for part in parts for o in _batch(tuple(paths), seed, part, kinds)]
    with ProcessPoolExecutor(jobs) as pool:
        futures = [pool.submit(_batch, tuple(paths), seed, part, kinds) for part in parts]
        return [o for future in futures for o in future.result()]


def main() -> int:
    """Print counts by kind and every breach."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("paths", nargs="+")
    parser.add_argument("--edits", type=int, default=500)
    parser.add_argument("--seed", type=int, default=datetime.now(UTC).toordinal())
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", type=int, help="number of one edit to try again")
    parser.add_argument("--kinds", nargs="*", default=(), choices=[*EDITS, []])
    args = parser.parse_args()
    if args.only is not None:
        found = [attempt(tuple(args.paths), args.seed, args.only, args.kinds)]
        print(found[0])
    else:
        found = campaign(args.paths, args.seed, args.edits, args.jobs, args.kinds)
    counts = {kind: Counter[str]() for kind in EDITS}
    for outcome in found:
        row = counts[outcome.kind]
        row["edits"] += 1
        row["refused"] += not outcome.became
        row["breaches"] += bool(outcome.breaches)
        for _, was, now in outcome.became:
            row["kept" if was == now else "inconclusive" if now == "inconclusive" else "other"] += 1
    heads = ("edits", "refused", "kept", "inconclusive", "other", "breaches")
    print(f"{'seed ' + str(args.seed):16}" + "".join(f"{h:>14}" for h in heads))
    for kind, row in counts.items():
        print(f"{kind:16}" + "".join(f"{row[h]:14}" for h in heads))
    bad = [outcome for outcome in found if outcome.breaches]
    kinds = f" --kinds {' '.join(args.kinds)}" if args.kinds else ""
    for o in bad:
        told = ", ".join(f"{rule} {was} -> {now}" for rule, was, now in o.breaches)
        paths = " ".join(args.paths)
        print(f"{o.kind} ({o.told}) of {o.episode}: {told}")
        print(f"    benchmarks/evidence.py {paths} --seed {args.seed} --only {o.number}{kinds}")
    print(f"{len(found)} edits, {len(bad)} breaches")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
