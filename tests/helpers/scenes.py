"""Small scenes whose truth is known: bodies on given paths, contacts with given forces."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from safestage_eval.episode import (
    Body,
    ContactTable,
    Episode,
    Geom,
    Header,
    RobotFrames,
    Source,
    Track,
    still_track,
)
from safestage_eval.episode.header import SKETCH
from safestage_eval.relations.statics import ARM, Pile, effects, moved

G = 9.81


def motion(pile: Pile, push: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """(B,) how strongly each body of a pile starts to move, in g; 0 where some forces balance it."""
    every, bodies = np.ones(len(pile.first), np.bool_), np.ones(len(pile.mass), np.bool_)
    return moved(pile, effects(pile), every, np.array(push), bodies)


def alone(normal: Any, friction: Any, point: Any) -> Pile:
    """A body of 1 kg that touches the ground in P points.

    ``normal`` (P, 3) into the body, ``friction`` (P,), ``point`` (P, 3) m from its centre of mass.
    """
    ground, inertia = np.full(len(normal), -1), ARM**2 * np.eye(3)[None]
    arrays = (np.asarray(values, float) for values in (point, normal, friction))
    return Pile(np.ones(1), np.zeros((1, 3)), inertia, ground, ground + 1, *arrays)


def moves(normal: Any, friction: Any, point: Any) -> float:
    """How strongly such a body starts to move, in g."""
    return float(motion(alone(normal, friction, point))[0])


class Scene:
    """Collects bodies and contacts, then becomes an episode of ``frames`` frames at ``rate`` Hz."""

    def __init__(self, frames: int = 60, rate: float = 120.0) -> None:
        self.frames, self.rate = frames, rate
        self.t = np.arange(frames) / rate
        self.bodies: list[Body] = []
        self.tracks: dict[str, Track] = {}
        self._rows: list[tuple[Any, ...]] = []

    def fixed(self, name: str, position: Any = (0, 0, 0), **fields: Any) -> Scene:
        """A body that never moves; a table 1 × 1 × 0.04 m with its top at z = 0 unless told."""
        geom = Geom(kind="box", size=(0.5, 0.5, 0.02), position=(0, 0, -0.02))
        fields = {"kind": "fixture", "geoms": (geom,), **fields}
        self.bodies.append(Body(name=name, movable=False, **fields))
        self.tracks[name] = still_track(tuple(map(float, position)), (1, 0, 0, 0))
        return self

    def box(
        self, name: str, half: float | tuple[float, ...], position: Any, **fields: Any
    ) -> Scene:
        """A box with its origin in its middle; ``position`` (3,) or (T, 3) m; ``fields`` as in ``body``."""
        size = (half,) * 3 if isinstance(half, float) else tuple(half)
        return self.body(name, Geom(kind="box", size=size), position, **fields)

    def body(
        self, name: str, geom: Geom, position: Any, orientation: Any = (1, 0, 0, 0), **fields: Any
    ) -> Scene:
        """A moving body; velocities follow from the path."""
        p = np.broadcast_to(np.asarray(position, float), (self.frames, 3))
        q = np.broadcast_to(np.asarray(orientation, float), (self.frames, 4))
        v = np.gradient(p, 1 / self.rate, axis=0) if self.frames > 1 else np.zeros_like(p)
        fields = {"kind": "object", "mass": 1.0, "up_axis": (0, 0, 1), **fields}
        self.bodies.append(Body(name=name, geoms=(geom,), **fields))
        self.tracks[name] = Track(
            p.astype(np.float32), q.astype(np.float32), v.astype(np.float32),
            np.zeros((self.frames, 3), np.float32),
        )  # fmt: skip
        return self

    def contact(
        self,
        by: str,
        on: str,
        points: Any,
        force: Any,
        normal: Any = (0, 0, 1),
        frames: slice | np.ndarray = slice(None),
    ) -> Scene:
        """``by`` pushes ``on`` with ``force`` (3,) N shared equally by the points (P, 3)."""
        points = np.atleast_2d(points)
        for frame in np.arange(self.frames)[frames]:
            for point in points:
                self._rows.append((frame, by, on, point, normal, np.asarray(force) / len(points)))
        return self

    def rests(self, on: str, by: str, half: float, at: Any, weight: float, **more: Any) -> Scene:
        """``on`` stands on ``by`` with four corners ``half`` m around ``at``, upward ``weight`` N."""
        corners = np.asarray(at, float) + half * np.array(
            [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float
        )
        return self.contact(by, on, corners, (0, 0, weight), **more)

    def episode(self, **header: Any) -> Episode:
        """The episode; ``header`` overrides its header's fields."""
        index = {body.name: i for i, body in enumerate(self.bodies)}
        first_geom = np.cumsum([0] + [len(body.geoms) for body in self.bodies])
        rows, totals = self._rows, Counter[Any]()
        for frame, by, on, _, normal, force in rows:  # of the pair, not of the row
            totals[frame, by, on] += abs(float(np.dot(force, normal)))
        contacts = ContactTable.build(
            [r[0] for r in rows],
            [index[r[1]] for r in rows],
            [index[r[2]] for r in rows],
            [first_geom[index[r[1]]] for r in rows],
            [first_geom[index[r[2]]] for r in rows],
            np.array([r[3] for r in rows]).reshape(-1, 3),
            np.array([r[4] for r in rows]).reshape(-1, 3),
            np.array([r[5] for r in rows]).reshape(-1, 3),
            [max(np.linalg.norm(r[5]), totals[r[:3]]) for r in rows],
            [0.0] * len(rows),
        )
        fields: dict[str, Any] = {
            "episode_id": "scene",
            "physics_dt": 1 / self.rate,
            "frame_dt": 1 / self.rate,
            "success": False,
            "termination": "horizon",
            "force_source": "recorded",
            "source": Source(recorder=SKETCH),  # drawn: nothing needs to move what moves
            **header,
        }
        return Episode(
            Header(bodies=tuple(self.bodies), **fields),
            self.t,
            self.tracks,
            contacts,
            RobotFrames.empty(self.frames),
        )
