"""ROS 1 and ROS 2 bags and Foxglove recordings with transforms.

A recording has one transform per frame and message, at the rate of whoever sent it. Here all frames
become bodies at common times: those of the messages where all agree, otherwise regular ones,
with positions interpolated linearly and orientations by slerp, as tf2 does it.
"""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode, Geom, Header, Mesh, Source, Track
from safestage_eval.episode.body import BodyKind
from safestage_eval.errors import TraceError
from safestage_eval.formats.discover import MCAP_MAGIC
from safestage_eval.geometry.pose import relative

from .account import Account
from .foreign_motion import fixed_if_still, make_track
from .foxglove_shapes import scene_geoms
from .frame_tree import FrameTree
from .importer import Importer, SourceError
from .missing_data import say_bodies, say_contacts, say_success
from .ros_bag import is_bag
from .scene_bodies import apply_map, fixed_from_map, need_shapes
from .tf_joints import place_arm
from .tf_messages import Found, error_line, has_transforms, read_messages
from .urdf_links import Link, urdf_links

F64 = NDArray[np.float64]

LONGEST = 5_000_000
"""Frames of a recording, about half a day; times that belong to two clocks come to more."""

GAP = 5
"""Frame spacings above which a gap without transforms is reported."""

_NO_SHAPES = "frames have none, and no scene or description gives any"


class Transforms(Importer):
    """One MCAP file, or a folder of a ROS 2 bag with its parts."""

    name = "tf"
    title = "ROS 1 and ROS 2 bags and Foxglove MCAP with transforms"

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By a schema of transforms; a bag's folder by its metadata.yaml."""
        if path.is_dir():
            bag = path / "metadata.yaml"
            if bag.is_file() and b"rosbag2_bagfile_information" in bag.read_bytes()[:200]:
                return "is a ROS 2 bag"
            return None
        try:
            with path.open("rb") as stream:
                stored = stream.read(len(MCAP_MAGIC)) == MCAP_MAGIC or is_bag(path)
        except OSError:
            return None
        return "has transforms" if stored and has_transforms(path) else None

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
        contents = read_messages(self._parts())
        if not contents.samples:
            raise SourceError(where, "holds no transform.", "transforms on /tf and /tf_static")
        tree = FrameTree(contents.samples, where)
        world = self._world(tree)
        meshes: dict[str, Mesh] = {}
        try:
            scene, left_out = scene_geoms(contents.entities.values(), meshes)
        except (ValueError, TypeError, AttributeError, OverflowError, IndexError) as error:
            raise TraceError(where, f"its scene cannot be read: {error_line(error)}.") from None
        links = {k: v for text in contents.descriptions for k, v in urdf_links(text, where).items()}
        bodies = self._bodies(tree, world, scene, links, meshes, account)
        need_shapes(bodies, where, among=_NO_SHAPES)
        t, start = self._times(tree, [body.name for body in bodies], account)
        pairs = [fixed_if_still(b, _motion(tree, b.name, world, start + t)) for b in bodies]
        more, still = fixed_from_map({body.name for body in bodies}, self.settings.map, meshes)
        every = (*(body for body, _ in pairs), *more)
        tracks = {**{body.name: motion for body, motion in pairs}, **still}
        arm = place_arm(self.settings, contents, tracks, start + t, tree.origin, meshes, account)
        every = (*every, *(body for body in arm.bodies if body.name not in tracks))
        tracks = {**arm.tracks, **tracks}
        self._remark(contents, left_out, links, every, account)
        from_map, dt = self.settings.map.source, float(np.median(np.diff(t)))
        header = Header(
            episode_id="",
            physics_dt=from_map.physics_dt or dt,
            frame_dt=dt,
            control_dt=from_map.control_dt,
            force_source="none",
            source=Source(simulator=None),
            bodies=every,
            joints=arm.joints,
        )
        used = {geom.mesh for body in every for geom in body.geoms}
        kept = {key: mesh for key, mesh in meshes.items() if key in used}
        return Episode(header, t, tracks, None, arm.frames, meshes=kept)

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

    def _world(self, tree: FrameTree) -> str:
        stated = self.settings.map.source.world
        frames = [*tree.roots, *tree.edges]
        if stated is not None:
            if stated not in frames:
                raise SourceError(
                    str(self.path), f"no frame {stated!r}.", ", ".join(sorted(frames))
                )
            return stated
        if len(tree.roots) > 1:
            raise SourceError(
                str(self.path),
                f"its frames make {len(tree.roots)} trees, with the roots {', '.join(tree.roots)}.",
                fix='say in the map file which is the world: [source] world = "…"',
            )
        return tree.roots[0]

    def _bodies(
        self,
        tree: FrameTree,
        world: str,
        scene: dict[str, tuple[Geom, ...]],
        links: dict[str, Link],
        meshes: dict[str, Mesh],
        account: Account,
    ) -> list[Body]:
        map_, root = self.settings.map, tree.root(world)
        wanted, lost, bare = [], [], []
        for name in (*tree.edges, *(root for root in tree.roots if root in scene)):
            placed = name in scene or (name in links and links[name].geoms) or map_.of_body(name)
            if not placed:
                bare.append(name)
            elif tree.root(name) != root:
                lost.append(name)
            else:
                wanted.append(self._body(name, tree, scene, links, meshes))
        if not wanted:
            objects = [Body(name=name, kind="object") for name in bare if tree.moves(name)]
            need_shapes(objects, str(self.path), among=_NO_SHAPES)
            raise SourceError(str(self.path), "no frame moves, and none has a shape.")
        if bare:
            account.missing(
                f"shapes of the frames {', '.join(sorted(bare))}", "they are no bodies",
                remedy="[body.NAME] shapes in the map file",
            )  # fmt: skip
        if lost:
            account.missing(
                f"the way from {world} to {', '.join(sorted(lost))}", "they are left out",
                cost="whatever these bodies do", remedy="record all of /tf and /tf_static",
            )  # fmt: skip
        held = {body.name for body in wanted}
        return [
            body if body.parent in held else body.model_copy(update={"parent": None})
            for body in wanted
        ]

    def _body(
        self,
        name: str,
        tree: FrameTree,
        scene: dict[str, tuple[Geom, ...]],
        links: dict[str, Link],
        meshes: dict[str, Mesh],
    ) -> Body:
        link = links.get(name, Link())
        kind: BodyKind = "robot" if link.robot else "object" if tree.moves(name) else "fixture"
        raw = Body(
            name=name,
            kind=kind,
            mass=link.mass,
            com=link.com,
            parent=link.parent if link.robot else None,
            geoms=link.geoms if link.robot and link.geoms else scene.get(name) or link.geoms,
            untold=("up_axis", "cavity"),
        )
        return apply_map(raw, self.settings.map, meshes)

    def _times(self, tree: FrameTree, names: list[str], account: Account) -> tuple[F64, float]:
        """(T,) s from the start, and the start in the clock of the recording."""
        chains = {link for name in names for link in tree.chain(name)}
        moving = [tree.edges[link] for link in sorted(chains) if tree.edges[link].moves]
        if not moving:
            moving = [max((tree.edges[link] for link in chains), key=lambda edge: len(edge.time))]
        start = max(float(edge.time[0]) for edge in moving)
        end = min(float(edge.time[-1]) for edge in moving)
        whole = max(float(e.time[-1]) for e in moving) - min(float(e.time[0]) for e in moving)
        dt = self.settings.stated_dt
        first = moving[0].time
        if dt is None and all(np.array_equal(first, edge.time) for edge in moving[1:]):
            times: F64 = first
        else:
            finest = min(float(np.median(np.diff(e.time))) for e in moving if len(e.time) > 1)
            dt = dt or finest
            if (end - start) / dt > LONGEST:
                raise TraceError(
                    str(self.path), f"{end - start:.4g} s, every {dt:.3g} s.",
                    f"{LONGEST:,} frames", "--dt, or leave out transforms of another time",
                )  # fmt: skip
            times = np.asarray(start + dt * np.arange(int((end - start) / dt + 1e-6) + 1))
            account.recomputed(
                "poses at common times",
                f"every {dt * 1e3:.3g} ms, interpolated between transforms",
                remedy="send all transforms with the same stamps",
            )
        if len(times) < 2:
            raise TraceError(
                str(self.path),
                f"its moving frames share {max(0.0, end - start):.3f} s.",
                "2 frames",
            )
        if whole - (times[-1] - times[0]) > 2 * float(np.median(np.diff(times))):
            account.missing(
                f"{whole - (times[-1] - times[0]):.2f} s at the ends",
                "not all frames were sent then",
            )
        gaps = np.diff(times)
        if gaps.max() > GAP * np.median(gaps):
            account.missing(
                f"transforms for {gaps.max():.2f} s", "the longest stretch without any",
                cost="what happened meanwhile",
            )  # fmt: skip
        return times - times[0], float(times[0])

    def _remark(
        self,
        contents: Found,
        left_out: list[str],
        links: dict[str, Link],
        bodies: Sequence[Body],
        account: Account,
    ) -> None:
        meshes = [file for link in links.values() for file in link.left_out]
        if left_out or meshes:
            account.missing(
                f"shapes: {', '.join(dict.fromkeys([*left_out, *meshes]))}",
                "files that a description names are not opened",
                cost="contacts and clearances there",
                remedy="[body.NAME] shapes in the map file",
            )
        if contents.disagreeing:
            account.guessed(
                f"the parent of {', '.join(sorted(contents.disagreeing))}",
                "they came under two; the first is kept",
            )
        if contents.others:
            account.missing(
                f"topics {', '.join(sorted(contents.others))}", "not taken over",
                remedy="[every] and [episode.NAME] in the map file for what they say",
            )  # fmt: skip
        kinds = [
            f"{b.name} is a {b.kind}" for b in bodies if self.settings.map.of_body(b.name) is None
        ]
        if kinds:
            account.guessed(
                f"that {', '.join(kinds)}", "by what moves, and by the joints of the description",
                remedy="[body.NAME] kind in the map file; gripper bodies need it",
            )  # fmt: skip
        account.recomputed("velocities", "by differences of poses, when a rule asks for them")
        say_bodies(account, bodies, self.settings.map, "the frames' origins")
        say_contacts(account)
        success = (
            self.settings.map.every.success,
            *(e.success for e in self.settings.map.episode.values()),
        )
        say_success(account, known=any(s is not None for s in success), hold=None)


def _motion(tree: FrameTree, name: str, world: str, t: F64) -> Track:
    position, orientation = tree.pose(name, t)
    if world in tree.edges:
        position, orientation = relative(*tree.pose(world, t), position, orientation)
    return make_track(position, orientation, None, None)


IMPORTER = Transforms
