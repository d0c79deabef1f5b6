"""ROS 1 and ROS 2 bags and Foxglove recordings with transforms.

A recording has one transform per frame and message, at the rate of whoever sent it. Here all frames
become bodies at common times: those of the messages where all agree, otherwise regular ones,
with positions interpolated linearly and orientations by slerp, as tf2 does it. Links of an arm that no transform places
are placed by its joint states, with the description in the bag or that of ``--robot``.
"""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode, Geom, Source, still_track
from safestage_eval.errors import TraceError
from safestage_eval.geometry.pose import relative

from .account import Account
from .bag_files import begins, topics
from .foreign_motion import make_track
from .foxglove_shapes import scene_geoms
from .frame_tree import FrameTree
from .importer import Importer, SourceError
from .missing_data import say_success
from .robot_file import load_robot, read_urdf
from .robot_model import RobotModel
from .scene_bodies import need_shapes
from .scene_builder import SceneBuilder
from .tf_messages import TRANSFORMS, Found, error_line, read_messages

F64 = NDArray[np.float64]

LONGEST = 5_000_000
"""Frames of a recording, about half a day; times that belong to two clocks come to more."""

GAP = 5
"""Frame spacings above which a gap without transforms is reported."""

_NO_SHAPES = "frames have none, and no scene or description gives any"


class Transforms(Importer):
    """One MCAP file or bag, or a folder of a ROS 2 bag with its parts."""

    name = "tf"
    title = "ROS 1 and ROS 2 bags and Foxglove MCAP with transforms"

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By a schema of transforms; a bag's folder by its metadata.yaml."""
        if path.is_dir():
            bag = path / "metadata.yaml"
            told = bag.is_file() and b"rosbag2_bagfile_information" in bag.read_bytes()[:200]
            return "is a ROS 2 bag" if told else None
        there = begins(path) and TRANSFORMS & set(topics(path).values())
        return "has transforms" if there else None

    def episodes(self) -> Sequence[str]:
        """The recording is one episode."""
        return [self.path.stem]

    def fingerprint(self, name: str) -> str:  # noqa: ARG002 — there is one
        """Return a digest of sizes, beginnings and ends of the files."""
        digest = sha256()
        for path in self._parts():
            size = path.stat().st_size
            with path.open("rb") as stream:
                digest.update(f"{path.name} {size} ".encode() + stream.read(1 << 16))
                stream.seek(max(0, size - (1 << 16)))
                digest.update(stream.read())
        return digest.hexdigest()[:16]

    def read(self, name: str, account: Account) -> Episode:  # noqa: ARG002 — there is one
        """Read bodies from frames; shapes from scene, robot description and map file."""
        where = str(self.path)
        found = read_messages(self._parts())
        if not found.samples:
            raise SourceError(where, "holds no transform.", "transforms on /tf and /tf_static")
        return _Scene(self, found, FrameTree(found.samples, where), account).read()

    def _parts(self) -> list[Path]:
        if self.path.is_file():
            return [self.path]
        parts = [path for ending in ("mcap", "db3") for path in self.path.glob(f"*.{ending}")]
        parts.sort(key=lambda path: (len(path.name), path.name))
        if not parts:
            raise SourceError(
                str(self.path), "a bag without files that can be read.", "*.mcap, *.db3",
                "compressed ones are unpacked first: zstd -d FILE.db3.zstd",
            )  # fmt: skip
        return parts


class _Scene(SceneBuilder):
    """A recording on its way to an episode."""

    def __init__(self, source: Importer, found: Found, tree: FrameTree, account: Account) -> None:
        super().__init__(source.settings, str(source.path), account)
        self._found, self._tree = found, tree
        self._world = self._stated_world()
        try:
            self._shapes, self._left_out = scene_geoms(found.entities.values(), self.meshes)
        except (ValueError, TypeError, AttributeError, OverflowError, IndexError) as error:
            what = f"its scene cannot be read: {error_line(error)}."
            raise TraceError(self.where, what) from None
        self._robots = [
            tree
            for text in found.descriptions
            for tree in read_urdf(text, "/robot_description", self.settings.assets)
        ]
        self._links: dict[str, Body] = {}
        for robot in self._robots:
            self.meshes.update(robot.meshes)
            self._left_out += robot.lost
            for link in robot.links:
                body = link.body if robot.joints else link.body.model_copy(update={"parent": None})
                self._links[body.name] = body

    def read(self) -> Episode:
        described = self._described()
        need_shapes(described, self.where, among=_NO_SHAPES)
        t, start = self._times([body.name for body in described])
        for body in described:
            position, orientation = self._tree.pose(body.name, start + t)
            if self._world in self._tree.edges:
                world = self._tree.pose(self._world, start + t)
                position, orientation = relative(*world, position, orientation)
            self.add(body, make_track(position, orientation, None, None))
        self._arm(start + t)
        self._remark()
        from_map, dt = self.settings.map.source, float(np.median(np.diff(t)))
        episode = self.episode(
            t, com="the frames' origins", physics_dt=from_map.physics_dt or dt,
            frame_dt=dt, control_dt=from_map.control_dt, source=Source(simulator=None),
        )  # fmt: skip
        self._remark_success()
        return episode

    def _stated_world(self) -> str:
        stated, roots = self.settings.map.source.world, self._tree.roots
        frames = [*roots, *self._tree.edges]
        if stated is not None and stated not in frames:
            raise SourceError(self.where, f"no frame {stated!r}.", ", ".join(sorted(frames)))
        if stated is None and len(roots) > 1:
            raise SourceError(
                self.where,
                f"its frames make {len(roots)} trees, with the roots {', '.join(roots)}.",
                fix='say in the map file which is the world: [source] world = "…"',
            )
        return stated or roots[0]

    # ---- bodies

    def _described(self) -> list[Body]:
        """Frames that scene, description or map file give a shape, and that are connected to the world."""
        tree, bodies, lost, bare = self._tree, [], [], []
        for name in (*tree.edges, *(root for root in tree.roots if root in self._shapes)):
            link = self._links.get(name)
            placed = name in self._shapes or (link is not None and (link.geoms or link.unseen))
            if not placed and self.settings.map.of_body(name) is None:
                bare.append(name)
            elif tree.root(name) != tree.root(self._world):
                lost.append(name)
            else:
                bodies.append(self._body(name, link))
        if not bodies:
            objects = [Body(name=name, kind="object") for name in bare if tree.moves(name)]
            need_shapes(objects, self.where, among=_NO_SHAPES)
            raise SourceError(self.where, "no frame moves, and none has a shape.")
        if bare:
            self.account.missing(
                f"shapes of the frames {', '.join(sorted(bare))}", "they are no bodies",
                remedy="[body.NAME] shapes in the map file",
            )  # fmt: skip
        if lost:
            self.account.missing(
                f"the way from {self._world} to {', '.join(sorted(lost))}", "they are left out",
                cost="whatever these bodies do", remedy="record all of /tf and /tf_static",
            )  # fmt: skip
        held = {body.name for body in bodies}
        return [b if b.parent in held else b.model_copy(update={"parent": None}) for b in bodies]

    def _body(self, name: str, link: Body | None) -> Body:
        shapes: tuple[Geom, ...] = self._shapes.get(name, ())
        if link is not None and any(
            name in _names(robot) for robot in self._robots if robot.joints
        ):
            return self.describe(link if link.geoms else link.model_copy(update={"geoms": shapes}))
        raw = Body(
            name=name,
            kind="object" if self._tree.moves(name) else "fixture",
            mass=link.mass if link is not None else None,
            com=link.com if link is not None else (0.0, 0.0, 0.0),
            geoms=shapes or (link.geoms if link is not None else ()),
            untold=("up_axis", "cavity"),
        )
        return self.describe(raw)

    def _arm(self, times: F64) -> None:
        """Joints by joint states, and the links that they place and no transform does.

        Raises:
            SourceError: a description was named whose joints the bag does not have.
        """
        stated, recorded = self.settings.robot, self._found.joints
        model = next((robot for robot in self._robots if robot.joints), None)
        if stated is not None:
            model = load_robot(stated, self.settings.assets)
        known = {joint.name for joint in model.joints} if model is not None else set()
        names = [name for name in recorded if name in known]
        if model is None or not names:
            if stated is not None:
                said = ", ".join([*recorded][:12]) or "none"
                raise SourceError(
                    str(stated), f"its joints are not those of the bag ({said}).",
                    fix="the description of the robot that was recorded",
                )  # fmt: skip
            return
        if all(link.body.name in self.tracks for link in model.links if link.joints):
            return  # transforms say it all
        base = model.links[0].body.name
        motion = self.tracks.get(base)
        if motion is None:
            motion = still_track((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
            self.account.guessed(
                f"place of {base}", "the origin of the world",
                remedy=f"a transform of it, or [body.{base}] position in the map file",
            )  # fmt: skip
        self.account.recomputed(
            "poses of the robot's links that no transform places", "from its joint states, linear between messages",
            cost="velocities are differences of the poses",
        )  # fmt: skip
        positions = {name: self._at(times, *recorded[name]) for name in names}
        self.place_links(model, base, motion, positions)

    def _at(self, times: F64, stamps: list[int], positions: list[float]) -> F64:
        """(T,) positions at the times of the frames; the first and last one beyond them."""
        order = np.argsort(stamps, kind="stable")
        at = (np.array(stamps, np.int64) - self._tree.origin)[order] * 1e-9
        return np.asarray(np.interp(times, at, np.array(positions)[order]))

    # ---- time

    def _times(self, names: list[str]) -> tuple[F64, float]:
        """(T,) s from the start, and the start in the clock of the recording."""
        tree = self._tree
        chains = {link for name in names for link in tree.chain(name)}
        moving = [tree.edges[link] for link in sorted(chains) if tree.edges[link].moves]
        if not moving:
            moving = [max((tree.edges[link] for link in chains), key=lambda edge: len(edge.time))]
        start = max(float(edge.time[0]) for edge in moving)
        end = min(float(edge.time[-1]) for edge in moving)
        whole = max(float(e.time[-1]) for e in moving) - min(float(e.time[0]) for e in moving)
        dt = self.settings.stated_dt
        times = moving[0].time
        if dt is not None or any(not np.array_equal(times, edge.time) for edge in moving[1:]):
            dt = dt or min(float(np.median(np.diff(e.time))) for e in moving if len(e.time) > 1)
            if (end - start) / dt > LONGEST:
                raise TraceError(
                    self.where, f"{end - start:.4g} s, every {dt:.3g} s.",
                    f"{LONGEST:,} frames", "--dt, or leave out transforms of another time",
                )  # fmt: skip
            times = np.asarray(start + dt * np.arange(int((end - start) / dt + 1e-6) + 1))
            self.account.recomputed(
                "poses at common times",
                f"every {dt * 1e3:.3g} ms, interpolated between transforms",
                remedy="send all transforms with the same stamps",
            )
        if len(times) < 2:
            shared = max(0.0, end - start)
            raise TraceError(self.where, f"its moving frames share {shared:.3f} s.", "2 frames")
        gaps, lost = np.diff(times), whole - (times[-1] - times[0])
        if lost > 2 * float(np.median(gaps)):
            self.account.missing(f"{lost:.2f} s at the ends", "not all frames were sent then")
        if gaps.max() > GAP * np.median(gaps):
            self.account.missing(
                f"transforms for {gaps.max():.2f} s", "the longest stretch without any",
                cost="what happened meanwhile",
            )  # fmt: skip
        return times - times[0], float(times[0])

    # ---- the account

    def _remark(self) -> None:
        found, map_ = self._found, self.settings.map
        if self._left_out:
            self.account.missing(
                f"shapes: {', '.join(dict.fromkeys(self._left_out))}",
                "files that a description names are not there",
                cost="contacts and clearances there",
                remedy="--assets DIR that has them, or [body.NAME] shapes in the map file",
            )
        if found.disagreeing:
            self.account.guessed(
                f"the parent of {', '.join(sorted(found.disagreeing))}",
                "they came under two; the first is kept",
            )
        if found.others:
            self.account.missing(
                f"topics {', '.join(sorted(found.others))}", "not taken over",
                remedy="[every] and [episode.NAME] in the map file for what they say",
            )  # fmt: skip
        kinds = [f"{b.name} is a {b.kind}" for b in self.bodies if map_.of_body(b.name) is None]
        if kinds:
            self.account.guessed(
                f"that {', '.join(kinds)}", "by what moves, and by the joints of the description",
                remedy="[body.NAME] kind in the map file",
            )  # fmt: skip
        self.account.recomputed("velocities", "by differences of poses, when a rule asks for them")

    def _remark_success(self) -> None:
        map_ = self.settings.map
        said = (map_.every.success, *(table.success for table in map_.episode.values()))
        say_success(self.account, known=any(s is not None for s in said), hold=None)


def _names(robot: RobotModel) -> set[str]:
    return {link.body.name for link in robot.links}


IMPORTER = Transforms
