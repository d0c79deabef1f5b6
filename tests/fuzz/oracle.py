"""Losses and gains of a damaged trace by its decoded columns, and the verdicts it may then have.

- Nothing changed: every verdict is the same.
- Something is gone, and nothing else changed: no verdict is safer.
- Values became other valid ones, a *lie*: nobody who reads the file can tell, and no verdict is
  compared. But where the file still states the content hash of the sound one, its digests must
  notice: a verdict is the same, or inconclusive, or the file is refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from outcome import Outcome, compared, unchanged, weakened

from safestage_eval.episode import ContactTable, Episode, Header, RobotFrames, Track
from safestage_eval.episode.content_hash import scene_text
from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef, discover
from safestage_eval.rules import RuleSet
from safestage_eval.verdicts import judge

NO_EVIDENCE = {
    "schema_version", "episode_id", "instruction", "prompt", "policy", "seed", "rollout", "source",
    "notes", "cameras", "video",
}  # fmt: skip
"""Header fields that no verdict rests on."""

MAY_BE_UNTOLD = {
    "success", "success_time", "post_success_hold", "horizon", "termination", "goal", "control_dt",
}  # fmt: skip
"""Header fields that are evidence, and gone when they are None."""

OF_A_BODY = {"mass", "finger", "tcp", "inertia"}
"""Compare a body."""


@dataclass
class Difference:
    """Differences between two traces."""

    lost: list[str] = field(default_factory=list)
    hashed: list[str] = field(default_factory=list)
    """Other values of what the content hash covers."""
    said: list[str] = field(default_factory=list)
    """Other values of what it does not: roles, goal, success, ..."""


@dataclass(frozen=True)
class Sound:
    """A sound trace: all of it in memory, its verdicts by rule, and the content hash that it states."""

    episode: Episode
    verdicts: Mapping[str, str]
    stated: str | None


def sound(where: Path | EpisodeRef, by: RuleSet) -> Sound:
    """The only episode under a path, or the one of a reference."""
    ref = where if isinstance(where, EpisodeRef) else discover(where)[0]
    episode = ref.open()
    verdicts = verdicts_of(episode, by)
    difference(episode, episode)  # loads what is read when it is first asked for
    return Sound(episode, verdicts, ref.content_hash)


def verdicts_of(episode: Episode, by: RuleSet) -> dict[str, str]:
    """Rule -> verdict, of the assigned rules where some are, and of all elsewhere."""
    assigned = any(code in by.rules for code in episode.header.rules)
    found = judge(episode, by, assigned_only=assigned)
    return {verdict.rule: verdict.verdict for verdict in found.verdicts}


def judged(path: Path, whole: Sound, what: str, by: RuleSet, *, damage: bool = False) -> Outcome:
    """Judge a damaged trace.

    ``damage``: checksums cover what was done to it, or it is no number any more, so that even what reads
    as another value may lead to no other verdict.
    """
    try:
        refs = discover(path)
        if len(refs) != 1:
            return Outcome("problem", what, f"{len(refs)} episodes")
        (ref,) = refs
        episode = ref.open()
        found = verdicts_of(episode, by)
    except InputError as error:
        return Outcome("problem", what, str(error))
    return held(whole, ref, episode, found, what, damage=damage)


def held(
    whole: Sound,
    ref: EpisodeRef,
    episode: Episode,
    found: Mapping[str, str],
    what: str,
    *,
    damage: bool,
) -> Outcome:
    """Verdicts of a trace against those of the sound one, by what the trace lost or gained."""
    changed = Difference()
    refused = None
    _header(changed, whole.episode.header, episode.header)
    try:
        _columns(changed, whole.episode, episode)
    except InputError as error:  # what no rule asked for is broken
        refused = f"; the rest is refused: {error}"
    if changed.said and not damage:
        return Outcome("lie", what, ", ".join(changed.said + changed.hashed)[:500])
    if changed.hashed or refused or changed.said:
        vouched = whole.stated is not None and ref.content_hash == whole.stated
        if damage or vouched or not changed.hashed:
            outcome = compared(whole.verdicts, found, what)
            text = ", ".join(changed.hashed + changed.said)[:300]
            return outcome._replace(said=f"{outcome.said} ({text}{refused or ''})")
        return Outcome("lie", what, ", ".join(changed.hashed)[:500])
    if changed.lost:
        outcome = weakened(whole.verdicts, found, what)
        return outcome._replace(said=f"{outcome.said} (gone: {', '.join(changed.lost)[:300]})")
    return unchanged(whole.verdicts, found, what)


def difference(whole: Episode, found: Episode) -> Difference:
    """Differences of the second from the first.

    Raises:
        InputError: something of the second cannot be read.
    """
    changed = Difference()
    _header(changed, whole.header, found.header)
    _columns(changed, whole, found)
    return changed


def _header(changed: Difference, whole: Header, found: Header) -> None:
    if whole == found:
        return
    for name in type(whole).model_fields:
        was, now = getattr(whole, name), getattr(found, name)
        if was == now or name in NO_EVIDENCE or name in ("bodies", "joints"):
            continue
        if name == "roles" and now.items() <= was.items():
            changed.lost.append("roles")
        elif (now is None and name in MAY_BE_UNTOLD) or (name, now) == ("force_source", "none"):
            changed.lost.append(name)
        else:
            changed.said.append(f"{name} {str(was)[:40]} = {str(now)[:40]}")
    if scene_text(whole) != scene_text(found):
        _scene(changed, whole, found)
    elif whole.bodies != found.bodies:
        changed.said.append("materials or tags")


def _scene(changed: Difference, whole: Header, found: Header) -> None:
    names = [[body.name for body in header.bodies] for header in (whole, found)]
    if names[0] != names[1] or whole.joints != found.joints:
        changed.hashed.append("bodies or joints")
        return
    for was, now in zip(whole.bodies, found.bodies, strict=True):
        for name in type(was).model_fields:
            a, b = getattr(was, name), getattr(now, name)
            if a == b:
                continue
            if b is None and name in OF_A_BODY:
                changed.lost.append(f"{was.name}.{name}")
            else:
                changed.hashed.append(f"{was.name}.{name}")


def _columns(changed: Difference, whole: Episode, found: Episode) -> None:
    place = np.searchsorted(whole.t, found.t)
    place[place == len(whole.t)] = 0
    if not np.array_equal(whole.t[place], found.t) or (np.diff(place) <= 0).any():
        changed.hashed.append("t")
        return
    if len(place) < len(whole.t):
        changed.lost.append(f"{len(whole.t) - len(place)} frames")
    for name, was, now in _pairs(whole, found):
        if was is None and now is None:
            continue
        if was is None or now is None:
            (changed.lost if now is None else changed.hashed).append(name)
            continue
        kept = was[place] if len(was) > 1 else was
        _values(changed, name, *(_over(max(len(kept), len(now)), c) for c in (kept, now)))
    _contacts(changed, whole.contacts, found.contacts, place)


def _pairs(whole: Episode, found: Episode) -> Iterator[tuple[str, Any, Any]]:
    """Columns by name, of both."""
    for name in {**whole.tracks, **found.tracks}:
        a, b = whole.tracks.get(name), found.tracks.get(name)
        for part in fields(Track):
            yield (
                f"{name}.{part.name}",
                None if a is None else getattr(a, part.name),
                None if b is None else getattr(b, part.name),
            )
    for part in fields(RobotFrames):
        was, now = getattr(whole.frames, part.name), getattr(found.frames, part.name)
        yield part.name, was if was.shape[1] else None, now if now.shape[1] else None
    for key in {**whole.channels, **found.channels}:
        yield f"channel {key}", whole.channels.get(key), found.channels.get(key)


def _over(frames: int, column: Any) -> Any:
    """A column of so many frames: the row of a fixed body stands for all of them."""
    return column if len(column) != 1 else np.broadcast_to(column, (frames, *column.shape[1:]))


def _values(changed: Difference, name: str, was: Any, now: Any) -> None:
    if was.shape != now.shape:
        changed.hashed.append(name)
        return
    none = np.isnan(now)
    if (none & ~np.isnan(was)).any():
        changed.lost.append(name)
    if ((was != now) & ~none).any():
        changed.hashed.append(name)


def _contacts(changed: Difference, was: ContactTable, now: ContactTable, place: Any) -> None:
    was = was.where(np.isin(was.frame, place))
    if len(was) != len(now) or not np.array_equal(was.frame, place[now.frame]):
        changed.hashed.append("contacts")
        return
    for part in fields(ContactTable):
        if part.name != "frame":
            a, b = getattr(was, part.name), getattr(now, part.name)
            if a.dtype.kind == "f":
                _values(changed, f"contacts.{part.name}", a, b)
            elif not np.array_equal(a, b):
                changed.hashed.append(f"contacts.{part.name}")
