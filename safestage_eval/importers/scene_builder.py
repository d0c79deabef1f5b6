"""One episode on its way from a source: bodies as the map file completes them, and what is missing."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode, Header, Mesh, RobotFrames, Track

from .account import Account
from .foreign_motion import fixed_if_still
from .gaps import Gaps
from .importer import Settings
from .missing_data import say_bodies, say_contacts
from .place_robot import Placed, place_robot
from .scene_bodies import apply_map, fixed_from_map, need_shapes

F64 = NDArray[np.float64]


class SceneBuilder:
    """Bodies, tracks and meshes of one episode.

    Attributes:
        bodies: so far, in their order.
        tracks: body → its motion.
        meshes: of their shapes, by key.
        gaps: what the source lacks; all of it is refused at once.
    """

    def __init__(self, settings: Settings, where: str, account: Account) -> None:
        self.settings, self.where, self.account = settings, where, account
        self.gaps = Gaps(where, settings.noted)
        self.bodies: list[Body] = []
        self.tracks: dict[str, Track] = {}
        self.meshes: dict[str, Mesh] = {}

    def describe(self, body: Body) -> Body:
        """Return the body with the entries of the map file. Raises InputError as ``apply_map``."""
        return apply_map(body, self.settings.map, self.meshes)

    def add(self, body: Body, motion: Track) -> None:
        """Add a described body; a fixture or robot that never moves becomes a fixed body."""
        body, motion = fixed_if_still(body, motion)
        self.bodies.append(body)
        self.tracks[body.name] = motion

    def place_robot(
        self,
        base: str,
        motion: Track,
        columns: F64,
        *,
        names: Sequence[str] = (),
        taken: Collection[str] = (),
    ) -> Placed | None:
        """Add all links of the robot that the user named; arguments and errors as of ``place_robot``."""
        placed = place_robot(
            self.settings, base, motion, columns, self.account, self.meshes, names=names,
            taken={*self.tracks, *taken},
        )  # fmt: skip
        if placed is not None:
            self.bodies += placed.bodies
            self.tracks.update(placed.tracks)
        return placed

    def need_shapes(self, among: str) -> None:
        """Note as a gap that no object has a shape; ``among``: where the source would have had them."""
        self.gaps.ask(lambda: need_shapes(self.bodies, self.where, among=among), None)

    def episode(self, t: F64, frames: RobotFrames | None, *, com: str, **header: Any) -> Episode:
        """The episode, with fixed bodies of the map file, without contacts.

        Args:
            t: (T,) s.
            frames: of the robot.
            com: where centres of mass are assumed to be, for a remark.
            header: its other fields.
        """
        more, still = fixed_from_map({*self.tracks}, self.settings.map, self.meshes)
        say_bodies(self.account, self.bodies, self.settings.map, com)
        say_contacts(self.account)
        bodies = (*self.bodies, *more)
        about = Header(episode_id="", force_source="none", bodies=bodies, **header)
        used = {geom.mesh for body in bodies for geom in body.geoms}
        meshes = {key: mesh for key, mesh in self.meshes.items() if key in used}
        return Episode(about, t, {**self.tracks, **still}, None, frames, meshes=meshes)


def robot_frames(frames: int, **columns: F64 | None) -> RobotFrames:
    """Columns of a robot over T frames, by the names of ``RobotFrames``; those left out are empty."""
    none = np.zeros((frames, 0))
    every = {name: columns.get(name) for name in RobotFrames.__dataclass_fields__}
    return RobotFrames(*((none if c is None else c).astype(np.float32) for c in every.values()))
