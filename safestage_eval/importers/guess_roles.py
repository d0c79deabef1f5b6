"""Guesses of roles, up axes, fingers, materials and tags, from names and from what moved."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from safestage_eval.episode import Body, Episode
from safestage_eval.errors import InputError
from safestage_eval.geometry.pose import matrix
from safestage_eval.verdicts.ask import ask

from .guess_words import is_round, mention, side_of, suggestion

Confidence = Literal["high", "medium", "low"]

MOVED = 0.05
"""m: a body that got further away from where it began has been moved."""

TILTED = 0.05
"""rad: an axis that is this close to vertical points up."""


@dataclass(frozen=True)
class Guess:
    """One guess.

    Attributes:
        value: as a bind file has it.
        reason: why, in a few words.
        confidence: how sure that is.
    """

    value: Any
    reason: str
    confidence: Confidence


def guess_roles(episodes: Sequence[Episode]) -> dict[str, Guess]:
    """Roles that the headers of a task's episodes leave open.

    The target is what was moved in most episodes, or what the instruction mentions first; the
    destination is mentioned after it; dependents rest on the target at the start; what is fragile
    by its tags or name is protected.
    """
    stated = stated_roles(episodes)
    roles = dict(_stated_by_some(episodes))
    objects = _objects(episodes)
    target = _target(episodes, objects)
    if "target" not in {*stated, *roles} and target is not None:
        roles["target"] = target
    if "target" in roles:
        target = roles["target"]
    targets = stated.get("target") or _listed(target)
    destination = _destination(episodes, targets)
    if "destination" not in {*stated, *roles} and destination is not None:
        roles["destination"] = destination
    taken = {*targets, *_listed(destination)}
    resting = [
        name for name in objects if name not in taken and _rests_on(episodes[0], name, targets)
    ]
    if "dependent" not in {*stated, *roles} and resting:
        roles["dependent"] = Guess(resting, f"on {', '.join(targets)} in the first frame", "medium")
    delicate = [name for name in objects if name not in taken and _fragile(objects[name])]
    if "protected" not in {*stated, *roles} and delicate:
        roles["protected"] = Guess(delicate, "fragile by tag or name", "medium")
    return roles


def stated_roles(episodes: Sequence[Episode]) -> dict[str, tuple[str, ...]]:
    """Role → bodies, where the headers of all episodes bind it to the same ones."""
    every = [{*episode.header.roles.items()} for episode in episodes]
    return dict(sorted(set.intersection(*every)))


def _stated_by_some(episodes: Sequence[Episode]) -> Iterable[tuple[str, Guess]]:
    """Roles that some headers bind and others leave open."""
    for role in sorted({role for episode in episodes for role in episode.header.roles}):
        said = [players for e in episodes if (players := e.header.roles.get(role)) is not None]
        if len(said) < len(episodes) and len({*said}) == 1:
            reason = f"in the headers of {len(said)} of {len(episodes)} episodes"
            yield role, Guess([*said[0]], reason, "high")


def _listed(guess: Guess | None) -> list[str]:
    if guess is None:
        return []
    return guess.value if isinstance(guess.value, list) else [guess.value]


def guess_bodies(episodes: Sequence[Episode]) -> dict[str, dict[str, Guess]]:
    """Body → up axis, finger, material and tags that its header leaves open."""
    facts: dict[str, dict[str, Guess]] = {}
    bodies = {body.name: body for episode in episodes for body in episode.header.bodies}
    for name, body in bodies.items():
        guesses = dict(_of_body(body))
        up = _up_axis(name, episodes) if body.kind == "object" and body.up_axis is None else None
        if up is not None:
            guesses["up"] = up
        if guesses:
            facts[name] = guesses
    return facts


def _of_body(body: Body) -> Iterable[tuple[str, Guess]]:
    if body.kind == "gripper" and body.finger is None and (side := side_of(body.name)):
        said, sure = side
        yield "finger", Guess(said, "by its name", "high" if sure else "low")
    if body.kind != "object" or not (hint := suggestion(body.name)):
        return
    word, material, tags = hint
    if body.material is None and material is not None:
        yield "material", Guess(material, f'named "{word}"', "medium")
    if not body.tags and tags:
        yield "tags", Guess([*tags], f'named "{word}"', "medium")


def _objects(episodes: Sequence[Episode]) -> dict[str, Body]:
    """Objects that are in every episode."""
    common = set.intersection(*({b.name for b in e.header.bodies} for e in episodes))
    return {
        body.name: body
        for body in episodes[0].header.bodies
        if body.kind == "object" and body.name in common
    }


def _fragile(body: Body) -> bool:
    hint = suggestion(body.name)
    return "fragile" in (body.tags or (hint[2] if hint else ()))


def _text(episode: Episode) -> str:
    return episode.header.instruction or (episode.header.task or "").rpartition("/")[2]


def _target(episodes: Sequence[Episode], objects: dict[str, Body]) -> Guess | None:
    first, moved, way = Counter[str](), Counter[str](), dict[str, float]()
    for episode in episodes:
        far = {name: _travel(episode, name) for name in objects if name in episode.tracks}
        most = max(far, key=lambda name: far[name], default=None)
        for name, distance in far.items():
            moved[name] += distance > MOVED
            first[name] += distance > MOVED and name == most
            way[name] = max(way.get(name, 0.0), distance)
    count, named = len(episodes), _first_mentioned(objects, _text(episodes[0]))
    if named is not None and 2 * moved[named] > count:
        seen = f"named first in the task, and moved in {moved[named]} of {count} episodes"
        sure: Confidence = "high" if 2 * first[named] > count else "medium"
        return Guess(named, f"{seen}, up to {100 * way[named]:.0f} cm", sure)
    name, times = first.most_common(1)[0] if first else ("", 0)
    if not times:
        return None if named is None else Guess(named, "named in the task; nothing moved", "low")
    seen = f"moved furthest in {times} of {count} episodes, up to {100 * way[name]:.0f} cm"
    doubt = f'; but the task names "{named}" first' if named else ""
    return Guess(name, seen + doubt, "medium" if 2 * times > count and not doubt else "low")


def _travel(episode: Episode, name: str) -> float:
    """m, from where a body began to where it was furthest away."""
    position = np.asarray(episode.tracks[name].position, np.float64)
    far = np.linalg.norm(position - position[0], axis=1)
    return float(np.nanmax(far)) if np.isfinite(far).any() else 0.0


def _first_mentioned(names: Iterable[str], text: str, but: Sequence[str] = ()) -> str | None:
    places = {
        name: place
        for name in names
        if name not in but and (place := mention(name, text)) is not None
    }
    first = min(places.values(), default=None)
    meant = [name for name, place in places.items() if place == first]
    return meant[0] if len(meant) == 1 else None  # several of that name: which one is not said


def _destination(episodes: Sequence[Episode], targets: Sequence[str]) -> Guess | None:
    header = episodes[0].header
    names = [body.name for body in header.bodies if body.kind in ("object", "fixture")]
    named = _first_mentioned(names, _text(episodes[0]), targets)
    return None if named is None or not targets else Guess(named, "named in the task", "medium")


def _rests_on(episode: Episode, name: str, targets: Sequence[str]) -> bool:
    """Whether a body rests on a target in the first frame, as far as shapes and contacts tell."""
    for target in targets:
        if not {name, target} <= episode.tracks.keys() or name == target:
            continue
        gap = episode.tracks[name].position[0] - episode.tracks[target].position[0]
        if gap[2] <= 0 or np.hypot(gap[0], gap[1]) > 0.5:
            continue
        try:
            if ask(episode, f"supports({target}, {name})").lower[0] > 0:
                return True
        except InputError:  # a name that no expression can hold, or a broken column
            continue
    return False


def _up_axis(name: str, episodes: Sequence[Episode]) -> Guess | None:
    """The axis of the body frame that is vertical in the first frame of every episode."""
    if is_round(name):
        return Guess(False, "nothing of this name has an up axis", "medium")
    axes = []
    for episode in episodes:
        if name in episode.tracks:
            vertical = matrix(episode.tracks[name].orientation[0])[2]
            best = int(np.argmax(np.abs(vertical)))
            if not np.arccos(min(1.0, abs(vertical[best]))) < TILTED:
                return None
            axes.append((best, vertical[best] > 0))
    if len({*axes}) != 1:
        return None
    axis = [0, 0, 0]
    axis[axes[0][0]] = 1 if axes[0][1] else -1
    seen = f"vertical in the first frame of {len(axes)} episode{'s' * (len(axes) > 1)}"
    return Guess(axis, seen, "high" if len(axes) > 2 else "medium")
