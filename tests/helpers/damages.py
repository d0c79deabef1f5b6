"""Damages that a recording itself shows: what a recorder or importer gets wrong, one function each.

Each takes a sound episode and the name of a body in it, and gives the damaged episode.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import evidence_edits
import numpy as np
from evidence_edits import selected, without

from safestage_eval.episode import ContactTable, Episode
from safestage_eval.geometry.pose import conjugate, rotate

Damage = Callable[[Episode, str], Episode]

TURN_90 = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], np.float32)
Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], np.float32)


def loaded(e: Episode) -> Episode:
    """The same, of which nothing is left in the file."""
    return replace(evidence_edits.loaded(e), attachments={}, meshes=dict(e.meshes))


def header(**changes: Any) -> Damage:
    """Other fields of the header."""
    return lambda e, _: replace(e, header=e.header.model_copy(update=changes))


def body(change: Callable[[Any], dict[str, Any]]) -> Damage:
    """Other fields of one body."""

    def damage(e: Episode, name: str) -> Episode:
        bodies = tuple(
            b.model_copy(update=change(b)) if b.name == name else b for b in e.header.bodies
        )
        return replace(e, header=e.header.model_copy(update={"bodies": bodies}))

    return damage


def shape(scale: float) -> Damage:
    """One body's shapes in another unit."""

    def change(b: Any) -> dict[str, Any]:
        geoms = tuple(
            g.model_copy(
                update={
                    "size": tuple(s * scale for s in g.size),
                    "position": tuple(p * scale for p in g.position),
                }
            )
            for g in b.geoms
        )
        return {"geoms": geoms}

    return body(change)


def track(*names: str, **changes: Callable[[Any], Any]) -> Damage:
    """Other columns of a track; of the body in question, of those named, or of all (``*``)."""

    def damage(e: Episode, name: str) -> Episode:
        chosen = names or (name,)
        tracks = {
            key: replace(t, **{c: f(getattr(t, c)).astype(np.float32) for c, f in changes.items()})
            if key in chosen or chosen == ("*",)
            else t
            for key, t in e.tracks.items()
        }
        return replace(e, tracks=tracks)

    return damage


def both(first: Damage, second: Damage) -> Damage:
    """One damage after the other."""
    return lambda e, name: second(first(e, name), name)


def clock(change: Callable[[Any], Any]) -> Damage:
    """Other time stamps."""
    return lambda e, _: replace(e, t=np.asarray(change(e.t.copy()), float))


def contacts(**changes: Callable[[Any], Any]) -> Damage:
    """Other columns of all contacts."""

    def damage(e: Episode, _: str) -> Episode:
        table = e.contacts
        found = {
            c: np.asarray(f(getattr(table, c)), getattr(table, c).dtype) for c, f in changes.items()
        }
        return replace(e, _contacts=replace(table, **found))

    return damage


def of_body(**changes: Callable[[Any], Any]) -> Damage:
    """Damage the contacts of one body."""

    def damage(e: Episode, name: str) -> Episode:
        i = e.body_index[name]
        rows = (e.contacts.body1 == i) | (e.contacts.body2 == i)

        def some(f: Callable[[Any], Any]) -> Callable[[Any], Any]:
            return lambda v: np.where(rows if v.ndim == 1 else rows[:, None], f(v), v)

        return contacts(**{c: some(f) for c, f in changes.items()})(e, name)

    return damage


def exchanged(*columns: str, other: str) -> Damage:
    """Columns of two bodies' tracks."""

    def damage(e: Episode, name: str) -> Episode:
        one, two = e.track(name), e.track(other)
        new = {
            name: replace(one, **{c: getattr(two, c) for c in columns}),
            other: replace(two, **{c: getattr(one, c) for c in columns}),
        }
        return replace(e, tracks={**e.tracks, **new})

    return damage


def moved_contacts(e: Episode, name: str) -> Episode:
    """The contacts of a body as if another one had them: the body that is furthest away."""
    i, table = e.body_index[name], e.contacts
    far = max(
        (b for b in e.header.bodies if b.kind == "robot" and b.geoms),
        key=lambda b: float(
            np.linalg.norm(e.track(b.name).position - e.track(name).position, axis=1).min()
        ),
    )
    j = e.body_index[far.name]
    first = {k: int(np.flatnonzero(e.geom_owner == k)[0]) for k in (i, j)}
    columns = {c.name: getattr(table, c.name) for c in fields(ContactTable)}
    for side in "12":
        own = columns[f"body{side}"] == i
        columns[f"body{side}"] = np.where(own, j, columns[f"body{side}"])
        columns[f"geom{side}"] = np.where(own, first[j], columns[f"geom{side}"])
    keep = columns["body1"] != columns["body2"]
    return replace(e, _contacts=ContactTable.build(*(v[keep] for v in columns.values())))


def later_contacts(frames: int) -> Damage:
    """Contacts counted from another frame."""

    def damage(e: Episode, _: str) -> Episode:
        table = e.contacts
        table = table.where(table.frame < len(e) - frames)
        return replace(e, _contacts=replace(table, frame=table.frame + np.int32(frames)))

    return damage


def local_points(e: Episode, name: str) -> Episode:
    """Contact points in the frame of the body, not of the world."""
    i, table, place = e.body_index[name], e.contacts, e.track(name)
    rows = np.flatnonzero((table.body1 == i) | (table.body2 == i))
    at, points = table.frame[rows], table.position.copy()
    away = (points[rows] - place.position[at]).astype(float)
    points[rows] = rotate(conjugate(place.orientation[at].astype(float)), away)
    return replace(e, _contacts=replace(table, position=points))


def body_velocities(e: Episode, name: str) -> Episode:
    """Velocities in the body's own axes."""
    one = e.track(name)
    turn = conjugate(one.orientation.astype(float))
    return track(
        linear_velocity=lambda v: rotate(turn, v.astype(float)),
        angular_velocity=lambda v: rotate(turn, v.astype(float)),
    )(e, name)


def from_then_on(share: float, change: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A column that is changed from a moment on."""

    def changed(values: Any) -> Any:
        found, at = values.copy(), int(share * len(values))
        found[at:] = change(found[at:])
        return found

    return changed


def at_one_frame(share: float, change: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A column that is changed at one moment."""

    def changed(values: Any) -> Any:
        found, at = values.copy(), int(share * len(values))
        found[at] = change(found[at])
        return found

    return changed


def without_body(e: Episode, name: str) -> Episode:
    """The body is not in the header, nor are its contacts and roles."""
    roles = {role: tuple(p for p in who if p != name) for role, who in e.header.roles.items()}
    left = {"roles": {role: who for role, who in roles.items() if who}}
    e = without(e, name)
    return replace(e, header=e.header.model_copy(update=left))


def cut(first: float, last: float) -> Damage:
    """Nothing was recorded from one moment (s before success) to another."""

    def damage(e: Episode, _: str) -> Episode:
        success = float(e.header.success_time or 0)
        keep = (e.t < success - first) | (e.t > success - last)
        return selected(e, keep)

    return damage


def robot(**changes: Callable[[Any], Any]) -> Damage:
    """Other columns of joints and gripper."""

    def damage(e: Episode, _: str) -> Episode:
        found = {c: f(getattr(e.frames, c)).astype(np.float32) for c, f in changes.items()}
        return replace(e, _frames=replace(e.frames, **found))

    return damage


def scaled(by: float) -> Callable[[Any], Any]:
    """Another unit."""
    return lambda v: v * np.float32(by)


def turned(matrix: Any) -> Callable[[Any], Any]:
    """Other axes."""
    return lambda v: v @ matrix.T


def xyzw(q: Any) -> Any:
    """Quaternions in the other order."""
    return np.roll(q, -1, axis=1)
