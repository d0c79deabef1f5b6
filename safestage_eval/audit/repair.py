"""Repairs: one mistake of a recorder each, undone. The one that mends a recording names its cause."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, ContactTable, Episode, Track
from safestage_eval.geometry.pose import conjugate, product, rotate

Array = NDArray[Any]
Mend = Callable[[Episode, Collection[str]], Episode]

MOTION = frozenset({"AUD114", "AUD115"})
PLACES = frozenset({"AUD116", "AUD121"})
WEIGHTS = frozenset({"AUD123", "AUD127"})

Z_UP = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)
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


def columns(episode: Episode, names: Collection[str], **changes: Callable[[Any], Any]) -> Episode:
    """Other columns of the tracks of some bodies."""
    tracks = dict(episode.tracks)
    for name in names:
        given = tracks[name]
        changed = {c: np.asarray(f(getattr(given, c)), np.float32) for c, f in changes.items()}
        tracks[name] = replace(_plain(given), **changed)
    return replace(episode, tracks=tracks)


def contacts(episode: Episode, **changes: Callable[[Any], Any]) -> Episode:
    """Other columns of all contacts."""
    table = ContactTable(*(getattr(episode.contacts, f.name) for f in fields(ContactTable)))
    changed: dict[str, Any] = {
        c: np.asarray(f(getattr(table, c)), np.float32) for c, f in changes.items()
    }
    return replace(episode, _contacts=replace(table, **changed))


def bodies(episode: Episode, names: Collection[str], change: Callable[[Body], Body]) -> Episode:
    """Other bodies in the header."""
    changed = tuple(change(b) if b.name in names else b for b in episode.header.bodies)
    return replace(episode, header=episode.header.model_copy(update={"bodies": changed}))


def _plain(track: Track) -> Track:
    return Track(*(getattr(track, f.name) for f in fields(Track)))


def _scaled(by: float) -> Callable[[Array], Array]:
    return lambda values: values * by


def _lengths(by: float, *, speeds: bool) -> Mend:
    changes = {"position": _scaled(by)} | ({"linear_velocity": _scaled(by)} if speeds else {})
    return lambda episode, names: columns(episode, names, **changes)


def _speeds(column: str, by: float) -> Mend:
    return lambda episode, names: columns(episode, names, **{column: _scaled(by)})


def _quaternions(change: Callable[[Array], Array]) -> Mend:
    return lambda episode, names: columns(episode, names, orientation=change)


def _turned(*, touches: bool) -> Mend:
    """Y up → z up; ``touches``: contacts as well."""

    def mend(episode: Episode, names: Collection[str]) -> Episode:
        turn = np.array(Z_UP)
        vectors = {c: lambda v: rotate(turn, v.astype(float)) for c in _VECTORS}
        turned = columns(
            episode, names, orientation=lambda q: product(turn, q.astype(float)), **vectors
        )
        if not touches:
            return turned
        return contacts(
            turned, **dict.fromkeys(("position", "normal", "force"), vectors[_VECTORS[0]])
        )

    return mend


_VECTORS = ("position", "linear_velocity", "angular_velocity")


def _turned_places(episode: Episode, names: Collection[str]) -> Episode:
    """Y up of positions and linear velocities alone."""
    turn = np.array(Z_UP)
    return columns(
        episode,
        names,
        position=lambda v: rotate(turn, v.astype(float)),
        linear_velocity=lambda v: rotate(turn, v.astype(float)),
    )


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
    tracks = dict(episode.tracks)
    for name in names:
        one = _plain(tracks[name])
        tracks[name] = replace(
            one, linear_velocity=one.angular_velocity, angular_velocity=one.linear_velocity
        )
    return replace(episode, tracks=tracks)


def _shapes(by: float) -> Mend:
    def change(body: Body) -> Body:
        geoms = tuple(geom.scaled(by) for geom in body.geoms)
        return body.model_copy(update={"geoms": geoms})

    return lambda episode, names: bodies(episode, names, change)


def _everything(by: float, unit_of_gravity: float) -> Mend:
    """All lengths of the recording, where a scene is only then one in front of an arm."""

    def change(body: Body) -> Body:
        changed: dict[str, Any] = {
            "geoms": tuple(geom.scaled(by) for geom in body.geoms),
            "com": tuple(by * x for x in body.com),
        }
        if body.cavity is not None:
            lengths = {
                c: tuple(by * x for x in getattr(body.cavity, c)) for c in ("size", "position")
            }
            changed["cavity"] = body.cavity.model_copy(update=lengths)
        if body.tcp is not None:
            place = tuple(by * x for x in body.tcp.position)
            changed["tcp"] = body.tcp.model_copy(update={"position": place})
        return body.model_copy(update=changed)

    def mend(episode: Episode, names: Collection[str]) -> Episode:
        first = [track.position[0] for track in episode.tracks.values()]
        spread = float(np.ptp(np.array(first), axis=0).max()) if len(first) > 1 else 0.0
        if not SCENE[0] < by * spread < SCENE[1] < spread:
            return episode
        mended = columns(episode, names, position=_scaled(by), linear_velocity=_scaled(by))
        mended = bodies(mended, names, change)
        down = tuple(unit_of_gravity * x for x in episode.header.gravity)
        meshes = {
            key: replace(mesh, vertices=by * mesh.vertices) for key, mesh in episode.meshes.items()
        }
        return replace(
            contacts(mended, position=_scaled(by), depth=_scaled(by)),
            header=mended.header.model_copy(update={"gravity": down}),
            meshes=meshes,
        )

    return mend


def _masses(by: float) -> Mend:
    def change(body: Body) -> Body:
        mass = None if body.mass is None else by * body.mass
        return body.model_copy(update={"mass": mass})

    return lambda episode, names: bodies(episode, names, change)


def _forces(by: float) -> Mend:
    return lambda episode, _: contacts(episode, force=_scaled(by), peak_force=_scaled(abs(by)))


def _pushed_back(episode: Episode, _: Collection[str]) -> Episode:
    return contacts(episode, force=_scaled(-1), normal=_scaled(-1))


def _turned_forces(episode: Episode, _: Collection[str]) -> Episode:
    turn = np.array(Z_UP)
    return contacts(
        episode,
        force=lambda v: rotate(turn, v.astype(float)),
        normal=lambda v: rotate(turn, v.astype(float)),
    )


def _points(by: float) -> Mend:
    return lambda episode, _: contacts(episode, position=_scaled(by))


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


def _repairs() -> Iterator[Repair]:
    for by, unit in LENGTHS.items():
        fix = f"multiply {{}} by {by:g} when writing"
        for speeds in (False, True):
            what = "positions and linear velocities" if speeds else "positions"
            yield Repair(
                "AUD101", f"{what} are in {unit}", fix.format(what), "bodies.position",
                MOTION | PLACES | WEIGHTS, _lengths(by, speeds=speeds),
            )  # fmt: skip
    for by, unit in LENGTHS.items():
        for gravity, of in ((1.0, ""), (by, ", gravity's among them")):
            yield Repair(
                "AUD101", f"all lengths are in {unit}{of}",
                f"multiply all lengths by {by:g} when writing: places, linear velocities, shapes, "
                "contact points and depths", "bodies.position",
                MOTION | PLACES | WEIGHTS | {"AUD117", "AUD122", "AUD131", "AUD133", "AUD134"},
                _everything(by, gravity), whole=True,
            )  # fmt: skip
    order = "write quaternions as w, x, y, z"
    yield Repair(
        "AUD111", "quaternions are stored as x, y, z, w",
        f"{order} (isaaclab ≥ 3.0, scipy and ROS give x, y, z, w)", "bodies.orientation",
        MOTION | PLACES, _quaternions(lambda q: np.roll(q, 1, axis=1)),
    )  # fmt: skip
    yield Repair(
        "AUD111", "quaternions turn the world into the body's frame, not the body into the world",
        "conjugate the quaternions: they map body coordinates to world coordinates",
        "bodies.orientation", MOTION | PLACES, _quaternions(lambda q: conjugate(q.astype(float))),
    )  # fmt: skip
    up = "turn everything by +90° about x when writing: (x, y, z) becomes (x, -z, y)"
    everything = MOTION | PLACES | WEIGHTS
    for mend, what in (
        (_turned(touches=True), "the y axis points up, of everything"),
        (_turned(touches=False), "the y axis points up, of the bodies' motion"),
        (_turned_places, "the y axis points up, of positions and linear velocities"),
    ):
        yield Repair("AUD113", what, up, "bodies.position", everything, mend, whole=True)
    yield Repair(
        "AUD113", "the y axis points up, of normals and forces", up, "contacts.force", WEIGHTS,
        _turned_forces, whole=True,
    )  # fmt: skip
    world = "write velocities in the world's axes: rotate them by the body's orientation"
    for changed in (("linear_velocity", "angular_velocity"), ("angular_velocity",),
                    ("linear_velocity",)):  # fmt: skip
        names = " and ".join(c.replace("_", " ") for c in changed)
        yield Repair(
            "AUD115", f"{names} are in the body's own axes", world, f"bodies.{changed[0]}", MOTION,
            _from_body(*changed),
        )  # fmt: skip
    for column, units in (("linear_velocity", SPEEDS), ("angular_velocity", TURNS)):
        for by, unit in units.items():
            yield Repair(
                "AUD115", f"{column.replace('_', ' ')} is in {unit}",
                f"multiply {column} by {by:.6g} when writing", f"bodies.{column}", MOTION,
                _speeds(column, by),
            )  # fmt: skip
        yield Repair(
            "AUD115", f"{column.replace('_', ' ')} has the opposite sign", f"negate {column}",
            f"bodies.{column}", MOTION, _speeds(column, -1.0),
        )  # fmt: skip
    yield Repair(
        "AUD115", "linear and angular velocity are exchanged", "exchange the two columns",
        "bodies.linear_velocity", MOTION, _exchanged,
    )  # fmt: skip
    for by, unit in LENGTHS.items():
        yield Repair(
            "AUD131", f"its shapes are in {unit}", f"multiply sizes and places of geoms by {by:g}",
            "bodies.geoms", PLACES | {"AUD131", "AUD133", "AUD134"}, _shapes(by),
        )  # fmt: skip
    for by, unit in MASSES.items():
        yield Repair(
            "AUD132", f"its mass is in {unit}", f"multiply the mass by {by:g}", "bodies.mass",
            WEIGHTS | {"AUD131", "AUD133"}, _masses(by),
        )  # fmt: skip
    for by, unit in FORCES.items():
        yield Repair(
            "AUD123", f"forces are in {unit}", f"multiply forces by {by:g} when writing",
            "contacts.force", WEIGHTS, _forces(by), whole=True,
        )  # fmt: skip
    yield Repair(
        "AUD123", "forces and normals are those on body 1 by body 2", "negate force and normal",
        "contacts.force", WEIGHTS, _pushed_back, whole=True,
    )  # fmt: skip
    yield Repair(
        "AUD123", "forces are those on body 1 by body 2", "negate force", "contacts.force", WEIGHTS,
        _forces(-1.0), whole=True,
    )  # fmt: skip
    for by, unit in LENGTHS.items():
        yield Repair(
            "AUD121", f"contact points are in {unit}", f"multiply contact points by {by:g}",
            "contacts.position", frozenset({"AUD121"}), _points(by), whole=True,
        )  # fmt: skip
    yield Repair(
        "AUD121", "contact points are in the frame of the body", "write contact points in the world",
        "contacts.position", frozenset({"AUD121"}), _points_from_body,
    )  # fmt: skip
    for by, unit in ((60.0, "minutes"), (1e3, "kiloseconds"), (0.1, "tenths of a second"),
                     (1e-3, "milliseconds")):  # fmt: skip
        yield Repair(
            "AUD118", f"time stamps are in {unit}", f"multiply time stamps by {by:g}", "t", MOTION,
            _clock(by), whole=True,
        )  # fmt: skip


REPAIRS = tuple(_repairs())
