"""Mistakes of recorders and scene builders, with amounts drawn at random, and the code that names each.

A mistake takes a sound episode, the name of a body in it and a generator, and gives the episode with
the mistake in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import damages as d
import numpy as np
from evidence_edits import selected

from safestage_eval.episode import ContactTable, Episode
from safestage_eval.formats import discover
from safestage_eval.geometry.pose import product

TRACES = Path(__file__).parents[2] / "traces"

Put = Callable[[Episode, str, np.random.Generator], Episode]

SHELF, CANS, GLASSES, BIN, CAN = (
    ("fsh_bottle_on_shelf.reference-safe", "bottle"),
    ("ets_apple_past_cans.reference-safe", "can_high"),
    ("ets_dumbbell_near_glasses.reference-safe", "glasses"),
    ("ish_bin_with_lemon.reference-safe", "small_bin"),
    ("ish_coffee_can_under_bottle.reference-safe", "coffee_can"),
)
"""Recordings that are sound, and a body in each."""

LINK = (SHELF[0], "robot_link5")

UNITS = (0.01, 0.001, 0.0254, 0.3048)
"""m in units that lengths are written in by mistake."""


@dataclass(frozen=True)
class Seeded:
    """One kind of mistake.

    Attributes:
        code: of the check that must name it.
        where: the recording and the body.
        put: what puts it in.
        cause: what the likely cause must mention.
        also: codes of other checks that report something else about it.
    """

    code: str
    where: tuple[str, str]
    put: Put
    cause: str = ""
    also: tuple[str, ...] = ()


@cache
def sound(name: str) -> Episode:
    """A recorded episode, loaded."""
    [ref] = [ref for ref in discover([TRACES]) if name in ref.episode_id]
    return d.loaded(ref.open())


def fixed(damage: d.Damage) -> Put:
    """A mistake of which there is only one amount."""
    return lambda episode, body, _: damage(episode, body)


def drawn(make: Callable[[Any], d.Damage], low: float, high: float) -> Put:
    """A mistake of an amount between two."""
    return lambda episode, body, rng: make(float(rng.uniform(low, high)))(episode, body)


def chosen(make: Callable[[Any], d.Damage], *amounts: Any) -> Put:
    """A mistake of one of some amounts."""
    return lambda episode, body, rng: make(amounts[rng.integers(len(amounts))])(episode, body)


def unit(*columns: str, of: tuple[str, ...] = ()) -> Callable[[float], d.Damage]:
    """Columns of tracks in a unit of so many m."""
    return lambda one: d.track(*of, **{column: d.scaled(1 / one) for column in columns})


def hole(episode: Episode, _: str, rng: np.random.Generator) -> Episode:
    """Between 0.6 and 2.5 s are missing somewhere in the middle."""
    long = rng.uniform(0.6, 2.5)
    begin = rng.uniform(0.2, 0.7) * (episode.t[-1] - long)
    return selected(episode, (episode.t <= begin) | (episode.t >= begin + long))


def thinned(episode: Episode, _: str, rng: np.random.Generator) -> Episode:
    """Every 10th to 30th sample alone, and a frame_dt that says so."""
    step = int(rng.integers(10, 30))
    found = selected(episode, np.arange(len(episode)) % step == 0)
    spacing = float(np.median(np.diff(found.t)))
    return d.header(frame_dt=spacing)(found, "")


def cut_tail(episode: Episode, _: str, rng: np.random.Generator) -> Episode:
    """Less than four seconds after success were recorded."""
    success = float(episode.header.success_time or 0)
    found = selected(episode, episode.t <= success + rng.uniform(0.1, 4))
    return d.header(post_success_hold=None)(found, "")


def misspelt(text: str, rng: np.random.Generator) -> str:
    """A name with one letter left out or two exchanged."""
    i = int(rng.integers(1, len(text) - 1))
    while text[i] == text[i - 1]:
        i = int(rng.integers(1, len(text) - 1))
    if rng.random() < 0.5:
        return text[:i] + text[i + 1 :]
    return text[: i - 1] + text[i] + text[i - 1] + text[i + 1 :]


def misspelt_role(episode: Episode, _: str, rng: np.random.Generator) -> Episode:
    """The role target under another name."""
    roles = dict(episode.header.roles)
    roles[misspelt("target", rng)] = roles.pop("target")
    return d.header(roles=roles)(episode, "")


def misspelt_player(episode: Episode, body: str, rng: np.random.Generator) -> Episode:
    """The body that plays a role under another name."""
    roles = {**episode.header.roles, "target": (misspelt(body, rng),)}
    return d.header(roles=roles)(episode, "")


def other_rule(episode: Episode, _: str, rng: np.random.Generator) -> Episode:
    """A rule of a number that no rule has."""
    return d.header(rules=(f"FSH{int(rng.integers(110, 199))}",))(episode, "")


def signs(episode: Episode, body: str, rng: np.random.Generator) -> Episode:
    """Some quaternions of the other sign."""
    flip = np.where(np.arange(len(episode)) % int(rng.integers(2, 200)), 1, -1)
    return d.track(orientation=lambda q: q * flip[:, None])(episode, body)


def other_clock(by: float, *, also: tuple[str, ...] = ()) -> d.Damage:
    """Time stamps in another unit; ``also``: fields of the header as well."""

    def damage(episode: Episode, name: str) -> Episode:
        values = {field: getattr(episode.header, field) * by for field in also}
        return d.header(**values)(d.clock(lambda t: t * by)(episode, name), name)

    return damage


def y_up(episode: Episode, _: str, __: np.random.Generator) -> Episode:
    """Everything of an engine whose y axis points up."""
    turn = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0, 0])
    vectors = dict.fromkeys(
        ("position", "linear_velocity", "angular_velocity"), d.turned(d.Y_UP.astype(float))
    )
    found = d.track("*", orientation=lambda q: product(turn, q.astype(float)), **vectors)(
        episode, ""
    )
    touches = dict.fromkeys(("position", "normal", "force"), d.turned(d.Y_UP))
    return d.contacts(**touches)(found, "")


def without_contacts(episode: Episode, body: str, _: np.random.Generator) -> Episode:
    """No contact of a body with anything but the robot is recorded."""
    table, i = episode.contacts, episode.body_index[body]
    robot = {n for n, b in enumerate(episode.header.bodies) if b.kind in ("robot", "gripper")}
    mine = (table.body1 == i) | (table.body2 == i)
    other = np.where(table.body1 == i, table.body2, table.body1)
    return replace(episode, _contacts=table.where(~mine | np.isin(other, list(robot))))


def every_body(**changes: Any) -> Put:
    """Other fields of all bodies, or of those that ``when`` holds for."""
    when = changes.pop("when", lambda _: True)

    def put(episode: Episode, _: str, __: np.random.Generator) -> Episode:
        bodies = tuple(
            b.model_copy(update=changes) if when(b) else b for b in episode.header.bodies
        )
        found = replace(episode, header=episode.header.model_copy(update={"bodies": bodies}))
        if "geoms" in changes:
            found = replace(found, _contacts=ContactTable.empty())
            found = d.header(force_source="none")(found, "")
        return found

    return put


def robot(b: Any) -> bool:
    """Damage the robot."""
    return b.kind in ("robot", "gripper")


def all_lengths(by: float, gravity: float = 1.0) -> d.Damage:
    """Everything that has a length in another unit, meshes too; ``gravity``: that of the header."""

    def damage(episode: Episode, name: str) -> Episode:
        lengths = d.scaled(by)
        episode = d.track("*", position=lengths, linear_velocity=lengths)(episode, name)
        episode = d.contacts(position=lengths, depth=lengths)(episode, name)
        for body in episode.header.bodies:
            episode = d.shape(by)(episode, body.name)
            longer = {"com": tuple(by * x for x in body.com)}
            for part in ("cavity", "tcp"):
                if given := getattr(body, part):
                    fields = [f for f in ("size", "position") if hasattr(given, f)]
                    new = {f: tuple(by * x for x in getattr(given, f)) for f in fields}
                    longer[part] = given.model_copy(update=new)
            episode = d.body(lambda _, new=longer: new)(episode, body.name)
        meshes = {k: replace(m, vertices=m.vertices * by) for k, m in episode.meshes.items()}
        down = tuple(gravity * x for x in episode.header.gravity)
        return replace(d.header(gravity=down)(episode, name), meshes=meshes)

    return damage


def slow_and_blind(damage: d.Damage) -> Put:
    """A mistake in a recording at 10 Hz that has no contacts."""

    def put(episode: Episode, body: str, _: np.random.Generator) -> Episode:
        at = np.arange(len(episode)) % 12 == 0
        episode = selected(episode, at)
        header = episode.header.model_copy(update={"force_source": "none", "frame_dt": 0.1})
        return damage(replace(episode, header=header, _contacts=ContactTable.empty()), body)

    return put


POSITION, LINEAR, ANGULAR = "position", "linear_velocity", "angular_velocity"

RECORDING = {
    # units
    "one body in another unit": Seeded("AUD101", SHELF, chosen(unit(POSITION), *UNITS), "are in"),
    "an obstacle in another unit": Seeded("AUD101", CANS, chosen(unit(POSITION), 0.01, 0.001), "are in"),
    "all positions in another unit": Seeded("AUD101", SHELF, chosen(unit(POSITION, of=("*",)), *UNITS), "are in"),
    "all lengths in centimetres": Seeded("AUD101", CAN, fixed(all_lengths(100.0)), "all lengths are in centimetres"),
    "all lengths in millimetres": Seeded("AUD101", SHELF, fixed(all_lengths(1000.0, gravity=1000.0)), "gravity's among them"),
    "positions and velocities in another unit": Seeded(
        "AUD101", CAN, chosen(unit(POSITION, LINEAR, of=("*",)), *UNITS), "linear velocities",
    ),
    "stamps in another unit": Seeded("AUD102", SHELF, chosen(other_clock, 1e3, 1e6, 1e9), "seconds"),
    "all times in milliseconds": Seeded(
        "AUD102", SHELF,
        fixed(other_clock(1e3, also=("physics_dt", "frame_dt", "control_dt", "success_time"))),
        "milliseconds",
    ),
    "gravity of the header is a default": Seeded("AUD117", BIN, drawn(lambda g: d.header(gravity=(0.0, 0.0, -g)), 15, 25)),
    "gravity in cm/s²": Seeded("AUD117", SHELF, fixed(d.header(gravity=(0.0, 0.0, -981.0)))),
    "stamps in minutes": Seeded("AUD118", SHELF, fixed(other_clock(1 / 60, also=("frame_dt", "physics_dt", "success_time"))), "minutes", also=("AUD109",)),
    "poses that a tracker lost": Seeded("AUD119", SHELF, drawn(lambda at: d.track(position=d.at_one_frame(at, d.scaled(np.nan))), 0.2, 0.8), "lost the body"),
    "velocities that were not measured": Seeded("AUD119", SHELF, drawn(lambda at: d.track(linear_velocity=d.from_then_on(at, d.scaled(np.nan))), 0.5, 0.8), "lost the body"),
    # clock
    "frame_dt off": Seeded("AUD103", SHELF, drawn(lambda by: d.header(frame_dt=by / 120), 1.2, 30)),
    "frame_dt in milliseconds": Seeded("AUD103", CAN, fixed(d.header(frame_dt=1000 / 120)), "milliseconds"),
    "frame_dt is a rate": Seeded("AUD103", CAN, fixed(d.header(frame_dt=120.0)), "rate"),
    "a hole": Seeded("AUD104", CANS, hole),
    "a clock from elsewhere": Seeded("AUD105", SHELF, drawn(lambda s: d.both(d.clock(lambda t: t + s), d.header(success_time=None, success=None, termination=None)), 1, 1e4)),
    "a clock since 1970": Seeded("AUD105", GLASSES, drawn(lambda s: d.clock(lambda t: t + s), 1.5e9, 1.8e9)),
    "success after the end": Seeded("AUD106", SHELF, drawn(lambda s: d.header(success_time=s), 30, 500)),
    "success as a frame number": Seeded("AUD106", SHELF, fixed(d.header(success_time=1306.0)), "frame number"),
    "physics_dt in milliseconds": Seeded("AUD107", SHELF, fixed(d.header(physics_dt=25 / 3))),
    "control rate in place of a step": Seeded("AUD107", SHELF, drawn(lambda s: d.header(control_dt=s), 1e-4, 4e-3)),
    "a time of success without success": Seeded("AUD108", SHELF, fixed(d.header(success=False))),
    "ended with success that was none": Seeded(
        "AUD108", SHELF, fixed(d.header(success=False, success_time=None, termination="success")),
    ),
    "a short tail": Seeded("AUD109", SHELF, cut_tail),
    "rare samples": Seeded("AUD110", CANS, thinned),
    # poses
    "quaternions in xyzw at 10 Hz, without contacts": Seeded(
        "AUD111", (SHELF[0], "bottle"), slow_and_blind(d.track("*", orientation=d.xyzw)), "x, y, z, w",
        also=("AUD110", "AUD125", "AUD210", "AUD211", "AUD212"),
    ),
    "all quaternions in xyzw": Seeded("AUD111", CAN, fixed(d.track("*", orientation=d.xyzw)), "x, y, z, w"),
    "one body's quaternions in xyzw": Seeded("AUD111", (SHELF[0], "robot_link6"), fixed(d.track(orientation=d.xyzw)), "x, y, z, w"),
    "quaternions that change their sign": Seeded("AUD112", SHELF, signs),
    "y up, of everything": Seeded("AUD113", SHELF, y_up, "y axis points up"),
    "y up, of positions and velocities": Seeded(
        "AUD113", SHELF, fixed(d.track("*", position=d.turned(d.Y_UP), linear_velocity=d.turned(d.Y_UP))), "y axis",
    ),
    "gravity along another axis": Seeded("AUD113", SHELF, fixed(d.header(gravity=(0.0, -9.81, 0.0)))),
    "a reset": Seeded(
        "AUD114", SHELF, drawn(lambda m: d.track(position=d.from_then_on(0.5, lambda p: p + np.float32([m, 0, 0]))), 0.2, 2),
    ),
    "a swapped row": Seeded(
        "AUD114", SHELF, drawn(lambda m: d.track(position=d.at_one_frame(0.4, lambda p: p + np.float32([0, m, 0]))), 0.2, 2),
    ),
    "velocities in another unit": Seeded("AUD115", SHELF, chosen(unit(LINEAR), 0.01, 0.001), "linear velocity is in"),
    "velocities too large": Seeded("AUD115", CAN, drawn(lambda by: d.track(linear_velocity=d.scaled(by)), 2.5, 9)),
    "angular velocities in degrees": Seeded("AUD115", SHELF, fixed(d.track(angular_velocity=d.scaled(57.29578))), "degrees"),
    "velocities of the other sign": Seeded("AUD115", SHELF, chosen(lambda c: d.track(**{c: d.scaled(-1)}), LINEAR, ANGULAR), "opposite"),
    "velocities in the body's axes": Seeded("AUD115", LINK, fixed(d.body_velocities), "own axes"),
    "velocities of another body": Seeded("AUD115", SHELF, fixed(d.exchanged(LINEAR, ANGULAR, other="robot_link3"))),
    "linear and angular velocity exchanged": Seeded("AUD115", LINK, lambda e, b, _: replace(
        e, tracks={**e.tracks, b: replace(
            e.tracks[b], linear_velocity=e.tracks[b].angular_velocity,
            angular_velocity=e.tracks[b].linear_velocity)}), "exchanged"),
    "a body below the floor": Seeded("AUD116", CAN, drawn(lambda m: d.track(position=lambda p: p - np.float32([0, 0, m])), 2, 5)),
    # contacts
    "contact points elsewhere": Seeded("AUD121", CAN, drawn(lambda m: d.of_body(position=lambda p: p + np.float32([m, 0, 0])), 0.3, 3)),
    "contact points in another unit": Seeded("AUD121", CAN, chosen(lambda one: d.contacts(position=d.scaled(1 / one)), 0.01, 0.001), "are in"),
    "contact points in the body's frame": Seeded("AUD121", CAN, fixed(d.local_points), "frame of the body"),
    "contacts counted from another frame": Seeded("AUD121", SHELF, lambda e, b, rng: d.later_contacts(int(rng.integers(400, 900)))(e, b)),
    "a body at another place": Seeded("AUD121", (SHELF[0], "bottle"), drawn(lambda m: d.track(position=lambda p: p + np.float32([0, 0, m])), 0.2, 1)),
    "depths in millimetres": Seeded("AUD122", SHELF, fixed(d.contacts(depth=d.scaled(1e3)))),
    "forces in another unit": Seeded(
        "AUD123", SHELF, chosen(lambda by: d.contacts(force=d.scaled(by), peak_force=d.scaled(by)), 1e-3, 1e3), "forces are in",
    ),
    "forces and normals on the other body": Seeded("AUD123", SHELF, fixed(d.contacts(force=d.scaled(-1), normal=d.scaled(-1))), "on body 1"),
    "forces on the other body": Seeded("AUD123", SHELF, fixed(d.contacts(force=d.scaled(-1))), "on body 1"),
    "peaks below the forces": Seeded("AUD124", SHELF, drawn(lambda by: d.contacts(peak_force=d.scaled(by)), 0.01, 0.5)),
    "forces that are zero": Seeded("AUD125", SHELF, fixed(d.contacts(force=d.scaled(0), peak_force=d.scaled(0)))),
    "forces that are NaN": Seeded("AUD125", SHELF, fixed(d.contacts(force=d.scaled(np.nan)))),
    "normals of another length": Seeded("AUD126", SHELF, drawn(lambda by: d.contacts(normal=d.scaled(by)), 0.1, 0.9)),
    "normals from body 2 to body 1": Seeded("AUD126", SHELF, fixed(d.contacts(normal=d.scaled(-1)))),
    "contacts with the table left out": Seeded("AUD127", CAN, without_contacts),
    # bodies
    "shapes in another unit": Seeded("AUD131", SHELF, chosen(d.shape, 100, 1000), "shapes are in"),
    "shapes too small": Seeded("AUD131", GLASSES, chosen(d.shape, 1e-3), "shapes are in"),
    "mass in grams": Seeded("AUD132", SHELF, fixed(d.body(lambda b: {"mass": b.mass * 1000})), "grams"),
    "mass of another model": Seeded("AUD132", CANS, drawn(lambda by: d.body(lambda b: {"mass": b.mass * by}), 1.3, 1.8), "another model"),
    "mass in tonnes": Seeded("AUD132", SHELF, fixed(d.body(lambda b: {"mass": b.mass / 1000})), "tonnes"),
    "centre of mass in the world": Seeded("AUD133", SHELF, drawn(lambda m: d.body(lambda _: {"com": (m, 0.3, 0.8)}), 0.4, 2)),
    "inertia in g cm²": Seeded("AUD133", SHELF, fixed(d.body(lambda b: {"inertia": tuple(1e7 * i for i in b.inertia)}))),
    "cavity in millimetres": Seeded("AUD134", BIN, fixed(d.body(
        lambda b: {"cavity": b.cavity.model_copy(update={"size": tuple(1e3 * s for s in b.cavity.size)})}))),
    "tool centre point in the world": Seeded("AUD134", (SHELF[0], "robot_base"), fixed(d.body(
        lambda b: {"tcp": b.tcp.model_copy(update={"position": (0.5, 0.3, 0.8)})}))),
    "no shapes": Seeded("AUD135", SHELF, every_body(geoms=()), also=("AUD157",)),
    "no fingers": Seeded("AUD136", SHELF, every_body(finger=None, when=robot)),
    "no tool centre point": Seeded("AUD136", SHELF, every_body(tcp=None, when=robot)),
    "no masses": Seeded("AUD137", SHELF, every_body(mass=None, when=lambda b: b.kind == "object")),
    "a link is missing": Seeded("AUD138", LINK, fixed(d.without_body)),
    "joints in degrees": Seeded("AUD141", SHELF, fixed(d.robot(joint_position=d.scaled(57.3), joint_velocity=d.scaled(57.3)))),
    "joint velocities in degrees": Seeded("AUD142", SHELF, fixed(d.robot(joint_velocity=d.scaled(57.3)))),
    "opening in percent": Seeded("AUD143", SHELF, drawn(lambda by: d.robot(gripper=d.scaled(by)), 2, 100)),
    "up axes of y up": Seeded("AUD144", CANS, every_body(
        up_axis=(0.0, 1.0, 0.0), when=lambda b: b.up_axis is not None)),
    # names
    "a player misspelt": Seeded("AUD151", SHELF, misspelt_player, "bottle"),
    "a role misspelt": Seeded("AUD152", SHELF, misspelt_role, "target"),
    "a role left out": Seeded("AUD152", SHELF, fixed(d.header(roles={}))),
    "a material misspelt": Seeded("AUD153", SHELF, lambda e, b, rng: d.body(
        lambda _: {"material": misspelt("ceramic", rng)})(e, b), "ceramic"),
    "a tag misspelt": Seeded("AUD154", GLASSES, lambda e, b, rng: d.body(
        lambda _: {"tags": (misspelt("fragile", rng),)})(e, b), "fragile"),
    "a rule that does not exist": Seeded("AUD155", SHELF, other_rule),
    "a parameter misspelt": Seeded("AUD156", SHELF, lambda e, b, rng: d.header(
        parameters={misspelt("min_clearance", rng): "12 cm"})(e, b), "min_clearance"),
    "a goal misspelt": Seeded("AUD156", SHELF, lambda e, b, rng: d.header(goal="no such goal")(e, b)),
    "a rule about forces without any": Seeded("AUD157", SHELF, lambda e, b, rng: d.header(
        rules=("FSH103",), force_source="none")(replace(e, _contacts=ContactTable.empty()), b)),
    "no rule assigned": Seeded("AUD158", SHELF, fixed(d.header(rules=(), family=None))),
    # format
    "quaternions of another norm": Seeded("AUD100", SHELF, drawn(lambda by: d.track(orientation=d.scaled(by)), 1.1, 3)),
    "time that goes back": Seeded("AUD100", SHELF, drawn(
        lambda s: d.clock(lambda t: np.where(np.arange(len(t)) == 900, t - s, t)), 0.02, 2)),
    "a mass below zero": Seeded("AUD100", SHELF, fixed(d.body(lambda b: {"mass": -b.mass}))),
}  # fmt: skip
"""Kinds of mistakes in recordings."""
