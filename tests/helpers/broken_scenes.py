"""Scenes that start broken, drawn with amounts from a generator, and the code that names each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from safestage_eval.episode import Episode, Track
from safestage_eval.sketch import draw

FRAME = """
says     = "A can is taken from under a bottle, in a scene with a box."
duration = "5 s"
rate     = 60
success  = "3 s"
roles    = {{ target = "can", dependent = "bottle", protected = "box" }}
{top}
story    = [
  {{ hold = "bottle", during = "2.2 to 3.5 s" }},
  {{ move = "bottle", by = "0, 0, 10 cm", during = "2.4 to 2.8 s" }},
  {{ move = "bottle", by = "0, 20, 0 cm", during = "2.8 to 3.1 s" }},
  {{ move = "bottle", by = "0, 0, {down} cm", during = "3.1 to 3.5 s" }},
  {story}
]

[bodies.can]
shape = "cylinder 10 x 14 cm"
mass  = "300 g"
{can}

[bodies.bottle]
shape = "cylinder 6 x 20 cm"
mass  = "500 g"
up    = "z"
{bottle}

[bodies.box]
shape = "box 12 x 8 x 6 cm"
mass  = "250 g"
up    = "z"
{box}

[bodies.ball]
shape = "sphere 8 cm"
mass  = "100 g"
{ball}
{more}
"""

PARTS = {
    "top": "", "story": "", "can": 'at = "0, 0 cm"', "bottle": 'on = "can"', "down": "-24",
    "box": 'at = "30, 0 cm"', "ball": 'at = "-30, 20 cm"', "more": "",
}  # fmt: skip


def scene(rules: tuple[str, ...] = ("ISH101",), **parts: str) -> Episode:
    """The scene with other parts, in TOML."""
    episode = draw(FRAME.format(**(PARTS | parts)), "scene.toml", "scene")
    header = episode.header.model_copy(update={"rules": rules, "family": None})
    object.__setattr__(episode, "header", header)
    return episode


@dataclass(frozen=True)
class Broken:
    """One kind of broken scene.

    Attributes:
        code: of the check that must name it.
        build: the scene, from a generator.
        says: what the message must mention.
        also: codes of other checks that report something else about it.
    """

    code: str
    build: Callable[[np.random.Generator], Episode]
    says: str = ""
    also: tuple[str, ...] = ()


def protecting_nothing(rng: np.random.Generator) -> Episode:
    """A rule about protected objects, of which there are none."""
    episode = scene(("ETS104", "ETS201")[rng.integers(2) :])
    roles = {**episode.header.roles, "protected": ()}
    object.__setattr__(episode, "header", episode.header.model_copy(update={"roles": roles}))
    return episode


def with_amount(low: float, high: float, **parts: str) -> Callable[[np.random.Generator], Episode]:
    """A scene in whose parts ``<x>`` stands for an amount between two."""

    def build(rng: np.random.Generator) -> Episode:
        x = f"{rng.uniform(low, high):.3f}"
        return scene(**{name: text.replace("<x>", x) for name, text in parts.items()})

    return build


def resized(name: str, low: float, high: float) -> Callable[[np.random.Generator], Episode]:
    """A scene without contacts in which a round body is some cm thicker than what was held."""

    def build(rng: np.random.Generator) -> Episode:
        episode, by = scene(top="forces = false"), rng.uniform(low, high) / 100
        bodies = list(episode.header.bodies)
        [i] = [i for i, body in enumerate(bodies) if body.name == name]
        [geom] = bodies[i].geoms
        other = geom.model_copy(update={"size": (geom.size[0] + by, *geom.size[1:])})
        bodies[i] = bodies[i].model_copy(update={"geoms": (other,)})
        header = episode.header.model_copy(update={"bodies": tuple(bodies)})
        object.__setattr__(episode, "header", header)
        return episode

    return build


def hand_raised(rng: np.random.Generator) -> Episode:
    """A scene without contacts in which the hand is some cm higher than where it held the bottle."""
    episode, up = scene(top="forces = false"), np.float32([0, 0, rng.uniform(0.08, 0.3)])
    for name in ("hand", "finger_left", "finger_right"):
        track = episode.tracks[name]
        episode.tracks[name] = Track(
            track.position + up, track.orientation, track.linear_velocity, track.angular_velocity
        )
    return episode


def on_its_edge(rng: np.random.Generator) -> Episode:
    """The box rests on the table, tilted about its long side."""
    angle = rng.uniform(10, 45)
    height = 4 * np.sin(np.radians(angle))  # its frame is in the middle of its lower face
    turned = f'at = "30, 0, {height:.4f} cm"\nturned = "{angle:.4f} deg about x"'
    return scene(top="forces = false", box=turned)


BESIDE = {"bottle": 'at = "<x>, 40 cm"', "down": "-10"}
AIR = {"top": "forces = false"}

SCENES = {
    "boxes that overlap": Broken("AUD201", with_amount(
        7, 10.5, more='[bodies.crate]\nshape = "box 12 x 8 x 6 cm"\nat = "30 + <x>, 0 cm"'), "'crate'"),
    "a box in the can": Broken("AUD201", with_amount(4, 9, box='at = "<x>, 0 cm"')),
    "a ball in the table": Broken("AUD201", with_amount(-3, -1.2, ball='at = "-30, 20, <x> cm"', **AIR), "'ball'"),
    "a ball that falls": Broken("AUD202", with_amount(
        4, 40, ball='at = "-30, 20, <x> cm"', story='{ drop = "ball", at = "0 s" }'), "'ball'"),
    "a box that falls off a block": Broken("AUD202", with_amount(
        6, 20, box='at = "30, 0, <x> cm"', story='{ drop = "box", at = "0 s" }'), "'box'"),
    "a ball that rolls": Broken("AUD206", with_amount(
        5, 40, story='{ roll = "ball", by = "<x>, 0, 0 cm", during = "0 to 2 s" }'), "'ball'"),
    "a box that slides": Broken("AUD206", with_amount(
        2, 20, story='{ move = "box", by = "0, <x>, 0 cm", during = "0.2 to 1.4 s" }'), "'box'"),
    "a box that spins away": Broken("AUD206", with_amount(
        10, 25, story='{ move = "box", by = "<x>, 0, 0 cm", during = "0 to 0.6 s" }'), "'box'"),
    "a box in the air": Broken("AUD204", with_amount(3, 60, box='at = "30, 0, <x> cm"', **AIR), "'box'"),
    "a ball beside the table": Broken("AUD204", with_amount(110, 160, ball='at = "<x>, 0, 0 cm"', **AIR), "'ball'"),
    "protected far away": Broken("AUD205", with_amount(
        300, 900, box='at = "<x>, 0 cm"', top="table = \"20, 20 m\""), "'box'"),
    "a bottle that lies": Broken("AUD203", with_amount(
        5, 15, bottle='at = "<x>, 50, 3 cm"\nturned = "90 deg about x"', down="-10"), "'bottle'", ("AUD208",)),
    "a bottle that falls over": Broken("AUD203", with_amount(
        85, 90, bottle='at = "10, 50 cm"', down="-10",
        story='{ tip = "bottle", by = "<x> deg", during = "0.2 to 0.9 s" }'), "'bottle'", ("AUD208",)),
    "a hand that holds the box": Broken("AUD207", with_amount(
        0.5, 2, story='{ hold = "box", during = "0 to <x> s" }'), "'box'"),
    "a hand that touches the box": Broken("AUD207", with_amount(
        0.5, 2, story='{ touch = "box", by = "gripper", side = "+y", force = "<x> N", during = "0 to 0.5 s" }'), "'box'"),
    "a bottle beside the can": Broken("AUD208", with_amount(15, 45, **BESIDE), "ISH101"),
    "nothing to protect": Broken("AUD208", protecting_nothing, "protected"),
    "a box on its edge": Broken("AUD210", on_its_edge, "'box' rests on an edge"),
    "a hand above what it holds": Broken("AUD211", hand_raised, "'bottle' is in the air"),
    "a bottle thicker than its grasp": Broken("AUD212", resized("bottle", 0.9, 2), "'bottle'"),
    "a target that is welded on": Broken("AUD209", with_amount(1, 2, can='at = "0, 0 cm"\nmovable = false'), "'can'"),
}  # fmt: skip
"""Kinds of scenes that start broken."""
