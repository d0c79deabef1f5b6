"""Repairs: one mistake of a recorder each, undone. The one that mends a recording names its cause."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, ContactTable, Episode, Track
from safestage_eval.geometry.pose import conjugate, product, rotate

Array = NDArray[Any]
Change = Callable[[Any], Any]
Mend = Callable[[Episode, Collection[str]], Episode]

MOTION = frozenset({"AUD114", "AUD115"})
PLACES = frozenset({"AUD116", "AUD121"})
WEIGHTS = frozenset({"AUD123", "AUD127"})
SHAPES = frozenset({"AUD131", "AUD133", "AUD134"})
POINTS = frozenset({"AUD121"})

Z_UP = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])
"""wxyz; turns y into z."""

LENGTHS = {
    0.01: "centimetres", 0.001: "millimetres", 0.0254: "inches", 0.3048: "feet", 0.1: "decimetres",
    1000.0: "kilometres",
}  # fmt: skip
"""m in a unit → its name."""

FORCES = {9.80665: "kilograms", 1000.0: "kilonewtons", 0.001: "millinewtons", 4.448: "pounds"}
RATE = 0.05
"""s between samples, at the most; poses are compared with velocities only then."""

SCENE = (0.1, 10.0)
"""m over which the bodies in front of an arm are spread, the arm among them."""

MASSES = {0.001: "grams", 1000.0: "tonnes", 0.4536: "pounds"}
SPEEDS = {0.01: "cm/s", 0.001: "mm/s", 0.0254: "inches per second", 1000.0: "km/s"}
TIMES = {60.0: "minutes", 1e3: "kiloseconds", 0.1: "tenths of a second", 1e-3: "milliseconds"}
TURNS = {np.pi / 180: "degrees per second", 2 * np.pi: "turns per second", 1e-3: "mrad/s"}


@dataclass(frozen=True)
class Repair:
    """One mistake, and how it is undone.

    Attributes:
        code: of the check that reports it.
        cause: the mistake, as the end of "it looks as if …".
        fix: what to do about it.
        field: the column that it is in.
        codes: of the checks whose contradictions it may explain.
        whole: it concerns the whole recording, never some of its bodies.
        mend: the episode with the mistake undone, for bodies of these names.
    """

    code: str
    cause: str
    fix: str
    field: str
    codes: frozenset[str]
    mend: Mend
    whole: bool = False


def columns(episode: Episode, names: Collection[str], **changes: Change) -> Episode:
    """Other columns of the tracks of some bodies."""
    tracks = dict(episode.tracks)
    for name in names:
        given = tracks[name].columns
        changed = {c: np.asarray(change(given[c]), np.float32) for c, change in changes.items()}
        tracks[name] = Track(**{**given, **changed})
    return replace(episode, tracks=tracks)


def contacts(episode: Episode, **changes: Change) -> Episode:
    """Other columns of all contacts."""
    given = {f.name: getattr(episode.contacts, f.name) for f in fields(ContactTable)}
    changed = {c: np.asarray(change(given[c]), np.float32) for c, change in changes.items()}
    return replace(episode, _contacts=ContactTable(**{**given, **changed}))


def _tracks(**changes: Change) -> Mend:
    return lambda episode, names: columns(episode, names, **changes)


def _touches(**changes: Change) -> Mend:
    return lambda episode, _: contacts(episode, **changes)


def _bodies(change: Callable[[Body], Mapping[str, Any]]) -> Mend:
    """Other fields of bodies in the header."""

    def mend(episode: Episode, names: Collection[str]) -> Episode:
        changed = tuple(
            body.model_copy(update=change(body)) if body.name in names else body
            for body in episode.header.bodies
        )
        return replace(episode, header=episode.header.model_copy(update={"bodies": changed}))

    return mend


def _all(*mends: Mend) -> Mend:
    def mend(episode: Episode, names: Collection[str]) -> Episode:
        for one in mends:
            episode = one(episode, names)
        return episode

    return mend


def _scaled(by: float) -> Change:
    return lambda values: values * by


def _upright(vectors: Array) -> Array:
    """Y up → z up."""
    return rotate(Z_UP, vectors.astype(float))


def _upright_orientation(quaternions: Array) -> Array:
    return product(Z_UP, quaternions.astype(float))


def _from_body(*changed: str) -> Mend:
    """Velocities in the body's own axes → in the world's."""

    def mend(episode: Episode, names: Collection[str]) -> Episode:
        for name in names:
            turn = episode.tracks[name].orientation.astype(float)
            turned = {c: lambda v, q=turn: rotate(q, v.astype(float)) for c in changed}
            episode = columns(episode, [name], **turned)
        return episode

    return mend


def _exchanged(episode: Episode, names: Collection[str]) -> Episode:
    """Linear and angular velocity."""
    for name in names:
        one = episode.tracks[name]
        other = {"linear_velocity": one.angular_velocity, "angular_velocity": one.linear_velocity}
        given = Track(**{**one.columns, **other})
        episode = replace(episode, tracks={**episode.tracks, name: given})
    return episode


def _smaller(body: Body, by: float) -> dict[str, Any]:
    """All lengths of a body, scaled."""
    changed: dict[str, Any] = {
        "geoms": tuple(geom.scaled(by) for geom in body.geoms),
        "com": tuple(by * x for x in body.com),
    }
    for part, lengths in (("cavity", ("size", "position")), ("tcp", ("position",))):
        if (given := getattr(body, part)) is not None:
            scaled = {name: tuple(by * x for x in getattr(given, name)) for name in lengths}
            changed[part] = given.model_copy(update=scaled)
    return changed


def _everything(by: float, unit_of_gravity: float) -> Mend:
    """All lengths of the recording, where a scene is only then one in front of an arm."""
    scaled = _scaled(by)
    lengths = _all(
        _tracks(position=scaled, linear_velocity=scaled),
        _bodies(lambda body: _smaller(body, by)),
        _touches(position=scaled, depth=scaled),
    )

    def mend(episode: Episode, names: Collection[str]) -> Episode:
        first = [track.position[0] for track in episode.tracks.values()]
        spread = float(np.ptp(np.array(first), axis=0).max()) if len(first) > 1 else 0.0
        if not SCENE[0] < by * spread < SCENE[1] < spread:
            return episode
        mended = lengths(episode, names)
        down = tuple(unit_of_gravity * x for x in episode.header.gravity)
        meshes = {
            key: replace(mesh, vertices=by * mesh.vertices) for key, mesh in episode.meshes.items()
        }
        header = mended.header.model_copy(update={"gravity": down})
        return replace(mended, header=header, meshes=meshes)

    return mend


def _points_from_body(episode: Episode, names: Collection[str]) -> Episode:
    """Contact points in the frame of a body → in the world."""
    table = episode.contacts
    points = table.position.astype(float)
    for name in names:
        i, track = episode.body_index[name], episode.track(name)
        rows = np.flatnonzero((table.body1 == i) | (table.body2 == i))
        at = table.frame[rows]
        turned = rotate(track.orientation[at].astype(float), points[rows])
        points[rows] = turned + track.position[at]
    return contacts(episode, position=lambda _: points)


def _clock(by: float) -> Mend:
    """Other time stamps, if these are then those of a recording: else nothing would be compared."""

    def mend(episode: Episode, _: Collection[str]) -> Episode:
        spacing = by * float(np.median(np.diff(episode.t)))
        if not 1e-4 <= spacing <= RATE:
            return episode
        header = episode.header.model_copy(update={"frame_dt": spacing})
        return replace(episode, header=header, t=episode.t * by)

    return mend


def _lengths() -> Iterator[Repair]:
    """Units of length: of positions, of everything, of shapes, of contact points."""
    for by, unit in LENGTHS.items():
        scaled = _scaled(by)
        for what, mend in (
            ("positions", _tracks(position=scaled)),
            ("positions and linear velocities", _tracks(position=scaled, linear_velocity=scaled)),
        ):
            fix = f"multiply {what} by {by:g} when writing"
            yield Repair("AUD101", f"{what} are in {unit}", fix, "bodies.position",
                         MOTION | PLACES | WEIGHTS, mend)  # fmt: skip
    for by, unit in LENGTHS.items():
        for gravity, of in ((1.0, ""), (by, ", gravity's among them")):
            fix = f"multiply all lengths by {by:g} when writing: places, linear velocities, shapes, contact points and depths"
            yield Repair("AUD101", f"all lengths are in {unit}{of}", fix, "bodies.position",
                         MOTION | PLACES | WEIGHTS | SHAPES | {"AUD117", "AUD122"},
                         _everything(by, gravity), whole=True)  # fmt: skip


def _orientations() -> Iterator[Repair]:
    """Orders of quaternions, and worlds in which y points up."""
    yield Repair("AUD111", "quaternions are stored as x, y, z, w",
                 "write quaternions as w, x, y, z (isaaclab ≥ 3.0, scipy and ROS give x, y, z, w)",
                 "bodies.orientation", MOTION | PLACES,
                 _tracks(orientation=lambda q: np.roll(q, 1, axis=1)))  # fmt: skip
    yield Repair("AUD111", "quaternions turn the world into the body's frame, not the body into the world",
                 "conjugate the quaternions: they map body coordinates to world coordinates",
                 "bodies.orientation", MOTION | PLACES,
                 _tracks(orientation=lambda q: conjugate(q.astype(float))))  # fmt: skip
    fix = "turn everything by +90° about x when writing: (x, y, z) becomes (x, -z, y)"
    places = {"position": _upright, "linear_velocity": _upright}
    motion = _tracks(orientation=_upright_orientation, angular_velocity=_upright, **places)
    touches = _touches(position=_upright, normal=_upright, force=_upright)
    for whose, mend in (
        ("everything", _all(motion, touches)),
        ("the bodies' motion", motion),
        ("positions and linear velocities", _tracks(**places)),
    ):
        yield Repair("AUD113", f"the y axis points up, of {whose}", fix, "bodies.position",
                     MOTION | PLACES | WEIGHTS, mend, whole=True)  # fmt: skip
    yield Repair("AUD113", "the y axis points up, of normals and forces", fix, "contacts.force",
                 WEIGHTS, _touches(force=_upright, normal=_upright), whole=True)  # fmt: skip


def _velocities() -> Iterator[Repair]:
    """Axes, units and signs of velocities."""
    world = "write velocities in the world's axes: rotate them by the body's orientation"
    both = "linear_velocity", "angular_velocity"
    for changed in (both, both[1:], both[:1]):
        names = " and ".join(c.replace("_", " ") for c in changed)
        yield Repair("AUD115", f"{names} are in the body's own axes", world, f"bodies.{changed[0]}",
                     MOTION, _from_body(*changed))  # fmt: skip
    for column, units in zip(both, (SPEEDS, TURNS), strict=True):
        name, field = column.replace("_", " "), f"bodies.{column}"
        for by, unit in units.items():
            yield Repair("AUD115", f"{name} is in {unit}", f"multiply {column} by {by:.6g} when writing",
                         field, MOTION, _tracks(**{column: _scaled(by)}))  # fmt: skip
        yield Repair("AUD115", f"{name} has the opposite sign", f"negate {column}", field, MOTION,
                     _tracks(**{column: _scaled(-1.0)}))  # fmt: skip
    yield Repair("AUD115", "linear and angular velocity are exchanged", "exchange the two columns",
                 "bodies.linear_velocity", MOTION, _exchanged)  # fmt: skip


def _bodies_and_contacts() -> Iterator[Repair]:
    """Units of shapes, masses, forces and contact points; sides and frames of contacts."""
    for by, unit in LENGTHS.items():
        mend = _bodies(lambda b, by=by: {"geoms": tuple(geom.scaled(by) for geom in b.geoms)})  # type: ignore[misc]
        yield Repair("AUD131", f"its shapes are in {unit}", f"multiply sizes and places of geoms by {by:g}",
                     "bodies.geoms", PLACES | SHAPES, mend)  # fmt: skip
    for by, unit in MASSES.items():
        mend = _bodies(lambda b, by=by: {"mass": None if b.mass is None else by * b.mass})  # type: ignore[misc]
        yield Repair("AUD132", f"its mass is in {unit}", f"multiply the mass by {by:g}", "bodies.mass",
                     WEIGHTS | {"AUD131", "AUD133"}, mend)  # fmt: skip
    back = _scaled(-1.0)
    for cause, fix, mend in (
        *((f"forces are in {unit}", f"multiply forces by {by:g} when writing",
           _touches(force=_scaled(by), peak_force=_scaled(by))) for by, unit in FORCES.items()),
        ("forces and normals are those on body 1 by body 2", "negate force and normal",
         _touches(force=back, normal=back)),
        ("forces are those on body 1 by body 2", "negate force", _touches(force=back)),
    ):  # fmt: skip
        yield Repair("AUD123", cause, fix, "contacts.force", WEIGHTS, mend, whole=True)
    for by, unit in LENGTHS.items():
        yield Repair("AUD121", f"contact points are in {unit}", f"multiply contact points by {by:g}",
                     "contacts.position", POINTS, _touches(position=_scaled(by)), whole=True)  # fmt: skip
    yield Repair("AUD121", "contact points are in the frame of the body",
                 "write contact points in the world", "contacts.position", POINTS,
                 _points_from_body)  # fmt: skip


def _clocks() -> Iterator[Repair]:
    for by, unit in TIMES.items():
        yield Repair("AUD118", f"time stamps are in {unit}", f"multiply time stamps by {by:g}", "t",
                     MOTION, _clock(by), whole=True)  # fmt: skip


REPAIRS = (*_lengths(), *_orientations(), *_velocities(), *_bodies_and_contacts(), *_clocks())
