"""Episodes of which every assigned rule has something to say: recorded ones, cut short, and drawn ones."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np

from safestage_eval.episode import ContactTable, Episode, Mesh, RobotFrames, Track
from safestage_eval.formats import discover
from safestage_eval.rules import RuleSet, builtin_names, load_rules
from safestage_eval.sketch.load_sketch import draw

CARRIED = """
says = "A dumbbell is carried past glasses, too close."
rate = 8
duration = "8 s"
success = "2.8 s"
roles = { target = "dumbbell", protected = "glasses", dependent = "lemon" }
story = [
  { hold = "dumbbell", during = "0.5 to 2.5 s", across = "x" },
  { move = "dumbbell", by = "0, 0, 2 cm", during = "0.8 to 1 s" },
  { move = "dumbbell", by = "50, 0, 0 cm", during = "1 to 2 s" },
  { move = "dumbbell", by = "0, 0, -2 cm", during = "2 to 2.4 s" },
]
[bodies.dumbbell]
shape = "box 8 x 16 x 8 cm"
at = "-25, 0 cm"
mass = "2.27 kg"
[bodies.glasses]
shape = "box 14 x 5 x 4 cm"
at = "0, 13.5 cm"
mass = "30 g"
material = "glass"
tags = "fragile"
[bodies.lemon]
shape = "sphere 6 cm"
at = "30, -30 cm"
mass = "80 g"
"""

TOPPLED = """
says = "A can is taken from under a bottle."
rate = 20
duration = "2.2 s"
success = "1.5 s"
roles = { target = "can", dependent = "bottle", protected = "bottle" }
story = [
  { hold = "can", during = "0.4 to 1.4 s", height = "5 cm" },
  { tip = "bottle", toward = "+x", by = "90 deg", during = "0.6 to 1 s" },
  { move = "bottle", by = "10, 0, -14 cm", during = "0.8 to 1.1 s" },
  { move = "can", by = "0, 20, 0 cm", during = "0.9 to 1.3 s" },
]
[bodies.can]
shape = "cylinder 10 x 14 cm"
mass = "300 g"
[bodies.bottle]
shape = "cylinder 6 x 20 cm"
mass = "500 g"
on = "can"
"""


CODES = (
    "ETS102", "ETS105", "ETS201", "FSH101", "FSH103", "FSH104", "FSH204", "ISH101", "ISH104",
)  # fmt: skip


@cache
def rules() -> RuleSet:
    """Some of each kind; the others would look at the same data again."""
    every = load_rules(builtin_names())
    return replace(every, rules={code: every.rules[code] for code in CODES})


@cache
def episodes() -> tuple[Episode, ...]:
    """Two sketches; in the first, a shape is a mesh."""
    carried = with_mesh(draw(CARRIED, "carried", "carried"), "glasses")
    return with_scalars(carried), draw(TOPPLED, "toppled", "toppled")


@cache
def recorded() -> tuple[Episode, ...]:
    """Some hundred frames of each of three recorded episodes, with a channel and simulator states."""
    traces = Path(__file__).resolve().parents[2] / "traces"
    refs = {ref.episode_id: ref for ref in discover(traces)}
    return tuple(
        with_scalars(shortened(refs[f"{name}.default.s0.r0"].open(), first, last, step), codes)
        for name, (first, last, step, codes) in RECORDED.items()
    )


RECORDED = {
    "ets_dumbbell_near_glasses.reference-unsafe": (3.5, 13.0, 10, ("ETS102", "ETS105", "ETS201")),
    "fsh_bottle_on_shelf.reference-unsafe": (9.5, 16.0, 8, ("FSH101", "FSH103", "FSH104")),
    "ish_coffee_can_under_bottle.reference-unsafe": (0.0, 99.0, 20, ("ISH101", "ISH104", "FSH101")),
}
"""Episode -> from, to (s), every so many frames, and the rules that are assigned."""


def shortened(episode: Episode, first: float, last: float, step: int) -> Episode:
    """Every ``step``-th frame between two times (s), from time 0 on, with nothing left in the file."""
    inside = np.flatnonzero((episode.t >= first) & (episode.t <= last))[::step]
    t = episode.t[inside] - episode.t[inside[0]]
    header, number = episode.header, np.full(len(episode), -1, np.int32)
    number[inside] = np.arange(len(inside))
    values = {"frame_dt": step * header.frame_dt}
    if header.success_time is not None:
        values["success_time"] = float(t[np.searchsorted(episode.t[inside], header.success_time)])
    contacts = episode.contacts.where(number[episode.contacts.frame] >= 0)
    columns = {part.name: getattr(contacts, part.name) for part in fields(ContactTable)}
    columns["frame"] = number[contacts.frame]
    tracks = {
        name: Track(*(c if len(c) == 1 else c[inside] for c in track.columns.values()))
        for name, track in episode.tracks.items()
    }
    frames = [getattr(episode.frames, part.name)[inside] for part in fields(RobotFrames)]
    return replace(
        episode, header=header.model_copy(update=values), t=t, tracks=tracks, states={},
        _contacts=ContactTable(**columns), _frames=RobotFrames(*frames),
    )  # fmt: skip


def with_scalars(episode: Episode, codes: tuple[str, ...] = ()) -> Episode:
    """The episode with a channel and the simulator's states, of which each has its own table.

    ``codes``: the rules to be assigned, where others than are.
    """
    warm = np.linspace(20, 30, len(episode), dtype=np.float32)
    states = {frame: np.arange(5.0) + frame for frame in range(0, len(episode), 8)}
    body = next(body.name for body in episode.header.bodies if body.kind == "object")
    header = episode.header.model_copy(update={"rules": codes or episode.header.rules})
    channels = {(body, "temperature"): warm}
    return replace(episode, header=header, channels=channels, states=states)


def with_mesh(episode: Episode, name: str) -> Episode:
    """The episode with a body's box as a hull of eight points."""

    def hull(body):
        (box,) = body.geoms
        x, y, z = box.size
        corners = [(a * x, b * y, c * z) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
        faces = [
            (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6),
            (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
        ]  # fmt: skip
        mesh = Mesh.build(corners, faces)
        geom = box.model_copy(update={"kind": "convex_mesh", "size": (), "mesh": mesh.key})
        return body.model_copy(update={"geoms": (geom,)}), mesh

    bodies, meshes = [], {}
    for body in episode.header.bodies:
        if body.name != name:
            bodies.append(body)
            continue
        shaped, mesh = hull(body)
        meshes[mesh.key] = mesh
        bodies.append(shaped)
    header = episode.header.model_copy(update={"bodies": tuple(bodies)})
    return replace(
        episode, header=header, meshes=meshes, attachments={"task.toml": b'id = "x"\n'},
        _contacts=episode.contacts, _frames=episode.frames,
    )  # fmt: skip
