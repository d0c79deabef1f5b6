"""One episode on its way from a source: bodies as the map file completes them, joints, and what is missing.

A robot of which only the joints are recorded has one body, its base; with its description (``--robot``) all its links
are placed by the joints.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode, Header, Joint, Mesh, RobotFrames, Track

from .account import Account
from .foreign_motion import fixed_if_still, make_track
from .importer import Settings, SourceError
from .missing_data import say_bodies, say_contacts, say_links
from .robot_file import load_robot
from .robot_model import RobotModel, match_joints, opening
from .scene_bodies import apply_map, fixed_from_map, need_shapes

F64 = NDArray[np.float64]
Value = TypeVar("Value")

JOINTED = "jointed"
"""Tag of the links that joints move; the others are one with the base."""


class SceneBuilder:
    """Bodies, tracks, joints and meshes of one episode.

    Attributes:
        bodies: so far, in their order.
        tracks: body → its motion.
        meshes: of their shapes, by key.
        joints: of the recorded columns of joint positions.
    """

    def __init__(self, settings: Settings, where: str, account: Account) -> None:
        self.settings, self.where, self.account = settings, where, account
        self.bodies: list[Body] = []
        self.tracks: dict[str, Track] = {}
        self.meshes: dict[str, Mesh] = {}
        self.joints: list[Joint] = []
        self._columns: dict[str, list[F64]] = {}
        self._gaps: list[SourceError] = []

    # ---- what is missing: one run names all of it

    def ask(self, call: Callable[[], Value], meanwhile: Value) -> Value:
        """Return what a call returns; if it lacks something, note that and go on with another value."""
        try:
            return call()
        except SourceError as error:
            self._gaps.append(error)
            return meanwhile

    def need_shapes(self, among: str) -> None:
        """Note as a gap that no object has a shape; ``among``: where the source would have had them."""
        self.ask(lambda: need_shapes(self.bodies, self.where, among=among), None)

    def refuse(self) -> None:
        """Raise SourceError if anything is missing, with all of it, each with its fix."""
        if self.settings.noted is not None:
            self.settings.noted.extend(self._gaps)
        elif len(self._gaps) == 1:
            raise self._gaps[0]
        elif self._gaps:
            gaps = " ".join(f"({i}) {error}" for i, error in enumerate(self._gaps, 1))
            raise SourceError(self.where, f"lacks {len(self._gaps)} things: {gaps}")

    # ---- bodies

    def describe(self, body: Body) -> Body:
        """Return the body with the entries of the map file. Raises InputError as ``apply_map``."""
        return apply_map(body, self.settings.map, self.meshes)

    def add(self, body: Body, motion: Track) -> None:
        """Add a described body; a fixture or robot that never moves becomes a fixed body."""
        body, motion = fixed_if_still(body, motion)
        self.bodies.append(body)
        self.tracks[body.name] = motion

    def record(self, **columns: F64 | None) -> None:
        """Add (T, k) columns of the robot, by the names of ``RobotFrames``, beside those that are there."""
        for name, values in columns.items():
            if values is not None:
                self._columns.setdefault(name, []).append(values)

    def articulation(
        self,
        name: str,
        motion: Track,
        position: F64,
        velocity: F64 | None = None,
        *,
        robot: bool = True,
        taken: Collection[str] = (),
    ) -> None:
        """Add a robot, or jointed furniture, of which root and joints are recorded.

        Args:
            name: of it.
            motion: of its root.
            position: (T, n) of its joints.
            velocity: (T, n) of them.
            robot: it is one; with ``--robot`` all its links are added.
            taken: names of other bodies that the scene will have.

        Raises:
            SourceError: as ``place_robot``.
        """
        own = f"{name}_base" if name in ("robot", "gripper") else name
        raw = Body(name=own, kind="robot" if robot else "fixture", untold=("links",))
        if robot and self.settings.robot is not None:
            _, motion = fixed_if_still(raw, motion)
            unit = self.place_robot(own, motion, position, taken=taken)
            self.record(joint_velocity=None if velocity is None else velocity * unit)
            return
        self.add(self.describe(raw), motion)
        self.record(joint_position=position, joint_velocity=velocity)
        numbers = range(position.shape[1])
        self.joints += [Joint(name=f"{name}_{i}", kind="revolute", body=own) for i in numbers]
        say_links(self.account, name)

    def place_robot(
        self,
        base: str,
        motion: Track,
        columns: F64,
        *,
        names: Sequence[str] = (),
        taken: Collection[str] = (),
    ) -> F64:
        """Add all links of the robot that the user named, its joints, and the opening of its gripper.

        Args:
            base: name of the body that is its first link.
            motion: of that body, T frames or one.
            columns: (T, n) recorded joint positions, rad or m unless the map's ``[robot]`` says otherwise.
            names: of the columns, as far as the source has any.
            taken: names of other bodies that the scene will have.

        Returns:
            (n,) rad or m for one of what the columns are in.

        Raises:
            SourceError: the columns are not those of its joints, or the file cannot be read.
        """
        path = self.settings.robot
        assert path is not None
        model, chosen = load_robot(path, self.settings.assets), self.settings.map.robot.joints
        matched = match_joints(model, names, columns.shape[1], chosen)
        if matched is None:
            said = f" ({', '.join(names)})" if names else ""
            raise SourceError(
                str(path),
                f"its joints ({', '.join(joint.name for joint in model.layers())}) are not those of the "
                f"{columns.shape[1]} recorded columns{said}.",
                fix='[robot] joints = ["…", …] in the map file, a name for each column in order; or another --robot',
            )
        if not chosen and set(matched) != set(names):
            self.account.guessed(
                f"order of the joints of {base}", f"{', '.join(matched)}, breadth first as in {path.name}",
                cost="with another order its links are elsewhere", remedy="[robot] joints in the map file",
            )  # fmt: skip
        self.account.recomputed(
            f"poses of the links of {base}", f"from its joints, by {path.name}",
            cost="velocities are differences of the poses",
        )  # fmt: skip
        if model.lost:
            self.account.missing(
                f"{len(model.lost)} meshes of {base}", ", ".join(model.lost[:3]),
                cost="clearances of these links: inconclusive", remedy="--assets DIR, a folder that has them",
            )  # fmt: skip
        unit = self._units(model, matched, columns)
        positions = {name: unit[i] * columns[:, i] for i, name in enumerate(matched)}
        self.place_links(model, base, motion, positions, taken)
        return unit

    def _units(self, model: RobotModel, matched: Sequence[str], columns: F64) -> F64:
        """(n,) rad or m for one of what each column is in.

        Raises:
            SourceError: joints that turn have angles of more than two turns, and nobody said in which unit.
        """
        kinds = {joint.name: joint.kind for joint in model.joints}
        turns = np.array([kinds[name] == "revolute" for name in matched])
        unit = self.settings.map.robot.angle
        largest = float(np.nanmax(np.abs(columns[:, turns]), initial=0))
        if unit is None and largest > 4 * np.pi:
            raise SourceError(
                str(self.settings.robot),
                f"its joints would turn by up to {largest:.4g} rad, more than two turns: the recorded columns "
                "are in degrees, or in a unit of the drives.",
                fix='[robot] angle = "deg" in the map file; "rad" if they do turn so far',
            )
        return np.where(turns & (unit == "deg"), np.pi / 180, 1.0)

    def place_links(
        self,
        model: RobotModel,
        base: str,
        motion: Track,
        positions: Mapping[str, F64],
        taken: Collection[str] = (),
    ) -> None:
        """Add the links of a model by ``positions``, joint → (T,) rad or m; of those that are there, only the joints."""
        self.meshes.update(model.meshes)
        length = len(next(iter(positions.values())))
        start = motion.position.astype(np.float64), motion.orientation.astype(np.float64)
        poses = model.place(start, positions)
        called = {
            link.body.name: f"{base}_{link.body.name}"
            if link.body.name in taken
            else link.body.name
            for link in model.links
        } | {model.links[0].body.name: base}
        jointed: set[str] = set()
        for link in model.links:
            if link.joints or link.body.parent in jointed:
                jointed.add(link.body.name)
            name = called[link.body.name]
            if name in self.tracks:
                continue
            said = {
                "name": name,
                "parent": called.get(link.body.parent or ""),
                "excluded": tuple(called[other] for other in link.body.excluded if other in called),
                "tags": (*link.body.tags, *([JOINTED] if link.body.name in jointed else ())),
            }
            body = self.describe(link.body.model_copy(update=said))
            track = motion
            if name != base:
                pose = poses[link.body.name]
                place, turn = (np.broadcast_to(part, (length, part.shape[-1])) for part in pose)
                body, track = fixed_if_still(body, make_track(place, turn, None, None))
            elif len(motion) == 1:
                body = body.model_copy(update={"movable": False})
            self.bodies.append(body)
            self.tracks[name] = track
        moved = {j.name: (called[link.body.name], j) for link in model.links for j in link.joints}
        self.joints += [
            Joint(name=name, kind=joint.kind, body=body, limits=joint.limits)
            for name, (body, joint) in ((name, moved[name]) for name in positions)
        ]
        open_ = opening(model, positions)
        self.record(
            joint_position=np.stack([*positions.values()], axis=1),
            gripper=None if open_ is None else open_[:, None],
        )

    # ---- the end

    def episode(self, t: F64, *, com: str, **header: Any) -> Episode:
        """The episode, with fixed bodies of the map file, without contacts.

        Args:
            t: (T,) s.
            com: where centres of mass are assumed to be, for a remark.
            header: its other fields.
        """
        more, still = fixed_from_map({*self.tracks}, self.settings.map, self.meshes)
        say_bodies(self.account, self.bodies, self.settings.map, com)
        say_contacts(self.account)
        bodies = (*self.bodies, *more)
        about = Header(
            episode_id="", force_source="none", bodies=bodies, joints=tuple(self.joints), **header
        )
        used = {geom.mesh for body in bodies for geom in body.geoms}
        meshes = {key: mesh for key, mesh in self.meshes.items() if key in used}
        none = np.zeros((len(t), 0))
        every = (
            np.hstack([none, *self._columns.get(n, ())]) for n in RobotFrames.__dataclass_fields__
        )
        frames = RobotFrames(*(column.astype(np.float32) for column in every))
        tracks = {**self.tracks, **still}
        return Episode(about, t, tracks, None, frames if self._columns else None, meshes=meshes)
