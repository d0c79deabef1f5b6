"""Recording an episode frame by frame, from any simulator or robot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from safestage_eval.episode import Body, Episode, Header, Joint, Mesh, RobotFrames, Track
from safestage_eval.episode.scene_invariants import check_bodies
from safestage_eval.errors import TraceError

from .contact_points import Contacts, GeomNames, contact_table, pack_contacts
from .frame_buffers import ROBOT_COLUMNS, FrameBuffers, put
from .header_limits import as_stored, validated

if TYPE_CHECKING:
    from .episode_ref import EpisodeRef

Pose = tuple[ArrayLike, ArrayLike]
"""Position (3,) in m and orientation (4,) wxyz: body frame to world."""


class TraceWriter:
    """Collects the frames of one episode and writes them when closed.

    Nothing touches the disk before ``close``; as a context manager with a ``path`` it closes itself
    at the end of the block, and leaves no file when the block raised.

    Args:
        header: everything that is said once; bodies may also come through ``add_body``.
        path: where ``close`` writes: a name ending in ``.mcap``, or a dataset's folder.
        meshes: those that ``Geom.mesh`` refers to.
        attachments: file name → bytes that belong to the episode.
        frames: how many frames to make room for; it grows by itself.
    """

    def __init__(
        self,
        header: Header,
        path: str | Path | None = None,
        *,
        meshes: Iterable[Mesh] | Mapping[str, Mesh] = (),
        attachments: Mapping[str, bytes] | None = None,
        frames: int = 1024,
    ) -> None:
        self.header = header
        self.path = None if path is None else Path(path)
        self.attachments = dict(attachments or {})
        some = meshes.values() if isinstance(meshes, Mapping) else meshes
        self.meshes = {mesh.key: mesh for mesh in some}
        self._fixed: dict[str, Track] = {}
        self._room = max(1, frames)
        self._closed = False
        self._buffers = FrameBuffers(0, 0, [0] * len(ROBOT_COLUMNS), ())
        self._states: dict[int, NDArray[np.float64]] = {}

    def __len__(self) -> int:
        """T, frames so far."""
        return self._buffers.length

    # ------------------------------------------------------------------ before the first frame

    def add_body(
        self,
        body: Body,
        position: ArrayLike | None = None,
        orientation: ArrayLike = (1.0, 0.0, 0.0, 0.0),
        *,
        meshes: Iterable[Mesh] = (),
    ) -> None:
        """Append a body to the header; a fixed one (``movable=False``) with its pose in the world.

        Raises:
            TraceError: after the first frame, when the name is taken, or when the body is not sound:
                numbers that are none, a mesh that nobody gave.
        """
        self._before_frames(f"body {body.name!r}")
        given = {mesh.key: mesh for mesh in meshes}
        if any(body.name == other.name for other in self.header.bodies):
            raise TraceError(self._where, f"two bodies are named {body.name!r}")
        for problem in check_bodies((body,), self._where):
            raise problem
        for key in {geom.mesh for geom in body.geoms} - {None, *self.meshes, *given}:
            raise TraceError(
                self._where,
                f"body {body.name!r} has a shape of mesh {key!r}, which was not given.",
                ", ".join(map(str, (*self.meshes, *given))),
                "pass it: add_body(body, meshes=[mesh])",
            )
        self.header = self.header.model_copy(update={"bodies": (*self.header.bodies, body)})
        self.meshes |= given
        if position is not None:
            self.set_fixed(body.name, position, orientation)

    def add_joint(self, joint: Joint) -> None:
        """Append a joint to the header. Raises TraceError after the first frame."""
        self._before_frames(f"joint {joint.name!r}")
        self.header = self.header.model_copy(update={"joints": (*self.header.joints, joint)})

    def set_fixed(
        self, name: str, position: ArrayLike, orientation: ArrayLike = (1.0, 0.0, 0.0, 0.0)
    ) -> None:
        """Set the one pose (m; wxyz; body frame to world) of a body that does not move.

        Raises:
            TraceError: no such body, or one declared movable.
        """
        if not any(body.name == name and not body.movable for body in self.header.bodies):
            raise TraceError(
                self._where,
                f"{name!r} is not a fixed body.",
                ", ".join(body.name for body in self.header.bodies if not body.movable),
                "declare it with movable=False",
            )
        self._fixed[name] = Track(
            np.array(position, np.float32).reshape(1, 3),
            np.array(orientation, np.float32).reshape(1, 4),
            np.zeros((1, 3), np.float32),
            np.zeros((1, 3), np.float32),
        )

    # ------------------------------------------------------------------ frames

    def add_frame(
        self,
        t: float,
        poses: Mapping[str, Pose] | NDArray[np.floating],
        twists: Mapping[str, tuple[ArrayLike, ArrayLike]] | NDArray[np.floating] | None = None,
        *,
        contacts: Contacts | None = None,
        joint_position: ArrayLike | None = None,
        joint_velocity: ArrayLike | None = None,
        joint_torque: ArrayLike | None = None,
        action: ArrayLike | None = None,
        gripper: ArrayLike | None = None,
        channels: Mapping[tuple[str, str], float] | None = None,
        state: ArrayLike | None = None,
    ) -> None:
        """Append one frame.

        Args:
            t: s from the episode's start; greater than the last frame's.
            poses: body name → (position (3,) m, orientation (4,) wxyz), body frame to world; or, at
                full speed, (B, 7) position + orientation of the *movable* bodies in the header's
                order. A fixed body's pose may be among the names; it counts once.
            twists: body name → (linear velocity (3,) m/s of the body frame's origin, angular
                velocity (3,) rad/s), both in the world frame; or (B, 6). A body that never has
                any is stored with zeros, and its velocities are derived from its poses when a rule
                asks for them; one that has them at times stands still at the others.
            contacts: see ``contact_points.pack``; rows, columns or a packed array.
            joint_position: (J,) rad or m, in the order of ``header.joints``.
            joint_velocity: (J,) rad/s or m/s.
            joint_torque: (J,) N m or N, by the actuators.
            action: (A,) the command in force.
            gripper: opening, 0 closed … 1 open.
            channels: (body, name) → value. Columns, like those of the robot, exist from the first
                frame on or not at all.
            state: (N,) float64 full integration state of the simulator; about one per second.

        Raises:
            TraceError: time does not increase, a body or column is unknown or missing, or a shape
                does not fit.
        """
        robot = (joint_position, joint_velocity, joint_torque, action, gripper)
        if not len(self):
            self._start(poses, robot, channels or {})
        buffers = self._buffers
        n = buffers.make_room()
        if self._closed:
            raise TraceError(self._where, "the writer is closed: no further frames")
        if n and not t > buffers.t[n - 1]:
            raise TraceError(
                self._where,
                f"time does not increase at frame {n}: {buffers.t[n - 1]:.6f} s, then {t:.6f} s.",
                "strictly increasing timestamps",
            )
        try:
            with np.errstate(over="ignore"):
                if isinstance(poses, np.ndarray):
                    put(buffers.pose[n], poses, "poses")
                else:
                    self._put_poses(n, poses)
                if twists is None:
                    buffers.twist[n] = 0
                elif isinstance(twists, np.ndarray):
                    put(buffers.twist[n], twists, "twists")
                else:
                    self._put_twists(n, twists)
                for name, values in zip(ROBOT_COLUMNS, robot, strict=True):
                    row = buffers.robot[name][n]
                    if values is not None:
                        put(row, values, name)
                    elif len(row):
                        raise KeyError(name)
                for key, column in buffers.channels.items():
                    column[n] = (channels or {})[key]
        except KeyError as error:
            raise TraceError(
                self._where,
                f"frame {n}: {error.args[0]!r} is missing.",
                fix="give every frame the bodies and columns of the first one",
            ) from None
        except (ValueError, TypeError) as error:
            raise TraceError(self._where, f"frame {n}: {error}") from None
        if channels and len(channels) != len(buffers.channels):
            extra = sorted(set(channels) - set(buffers.channels))
            raise TraceError(
                self._where, f"frame {n}: channel {extra[0]} was not there at frame 0."
            )
        points = (
            pack_contacts(contacts, self._names) if contacts is not None and len(contacts) else None
        )
        if state is not None:
            self._states[n] = np.array(state, np.float64).ravel()
        buffers.finish_frame(t, points)

    def update_header(self, **fields: Any) -> None:
        """Set header fields that are known only now (``success``, ``success_time``, …).

        Raises:
            TraceError: a field that headers do not have, a value that they refuse, or bodies and joints
                after a frame.
        """
        unknown = sorted(set(fields) - set(Header.model_fields))
        if unknown:
            raise TraceError(
                self._where,
                f"a header has no field {unknown[0]!r}.",
                ", ".join(Header.model_fields),
            )
        if {"bodies", "joints"} & set(fields):
            self._before_frames("bodies and joints")
        known = {"episode_id": "", "physics_dt": 1, "frame_dt": 1}
        checked = validated(Header, known | fields, f"{self._where}, header field")
        self.header = self.header.model_copy(
            update={name: getattr(checked, name) for name in fields}
        )

    # ------------------------------------------------------------------ what there is so far

    def episode(self) -> Episode:
        """Return all frames so far, as views of the writer's buffers. Raises TraceError without frames."""
        return self.window(0, len(self))

    def window(self, first: int, last: int) -> Episode:
        """Return frames first … last − 1 as an episode, with their times as recorded.

        Raises:
            TraceError: the range is empty or not recorded yet, or a fixed body has no pose.
        """
        buffers = self._buffers
        if not 0 <= first < last <= buffers.length:
            raise TraceError(
                self._where, f"frames {first}…{last - 1} asked, {buffers.length} recorded"
            )
        pose, twist = buffers.pose[first:last], buffers.twist[first:last]
        tracks = dict(self._fixed)
        for i, name in enumerate(self._movable):
            tracks[name] = Track(pose[:, i, :3], pose[:, i, 3:], twist[:, i, :3], twist[:, i, 3:])
        for body in self.header.bodies:
            if body.name not in tracks:
                raise TraceError(
                    self._where,
                    f"the fixed body {body.name!r} has no pose.",
                    fix=f"call set_fixed({body.name!r}, position, orientation)",
                )
        points, counts = buffers.contacts(first, last)
        names = self._names
        return Episode(
            header=self.header,
            t=buffers.t[first:last],
            tracks=tracks,
            _contacts=lambda: contact_table(points, counts, names),
            _frames=RobotFrames(*(buffers.robot[name][first:last] for name in ROBOT_COLUMNS)),
            meshes=self.meshes,
            channels={key: column[first:last] for key, column in buffers.channels.items()},
            states={n - first: s for n, s in self._states.items() if first <= n < last},
            attachments=self.attachments,
        )

    # ------------------------------------------------------------------ the end

    def close(self, path: str | Path | None = None) -> EpisodeRef:
        """Check and write the episode, whole or not at all; the format follows from the name.

        Raises:
            TraceError: no path, no frames, or the episode breaks an invariant.
        """
        from .save import save

        target = self.path if path is None else Path(path)
        if target is None:
            raise TraceError(self._where, "no path to write to.", fix="close(path)")
        ref = save(self.episode(), target)
        self._closed = True
        return ref

    def __enter__(self) -> Self:
        """The writer itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close, unless the block raised or closed already or there is nowhere to write to."""
        if kind is None and self.path is not None and not self._closed:
            self.close()

    # ------------------------------------------------------------------ inside

    @property
    def _where(self) -> str:
        return f"recording {self.header.episode_id!r}"

    def _before_frames(self, item: str) -> None:
        if len(self):
            raise TraceError(self._where, f"{item} cannot be added after the first frame")

    def _start(
        self,
        poses: Mapping[str, Pose] | NDArray[np.floating],
        robot: tuple[ArrayLike | None, ...],
        channels: Mapping[tuple[str, str], float],
    ) -> None:
        """Lay out the buffers from the first frame."""
        self.header = as_stored(self.header)
        self._names = GeomNames(self.header)
        self._movable = tuple(body.name for body in self.header.bodies if body.movable)
        if not isinstance(poses, np.ndarray):
            for body in self.header.bodies:
                if not body.movable and body.name in poses and body.name not in self._fixed:
                    self.set_fixed(body.name, *poses[body.name])
        widths = [0 if values is None else np.size(values) for values in robot]
        self._buffers = FrameBuffers(self._room, len(self._movable), widths, channels)

    def _put_poses(self, n: int, poses: Mapping[str, Pose]) -> None:
        self._known(poses, n)
        for i, name in enumerate(self._movable):
            pose = self._buffers.pose[n, i]
            pose[:3], pose[3:] = poses[name]
        for name in self._fixed.keys() & poses.keys():
            still, (position, orientation) = self._fixed[name], poses[name]
            if not (
                np.array_equal(still.position[0], np.asarray(position, np.float32))
                and np.array_equal(still.orientation[0], np.asarray(orientation, np.float32))
            ):
                raise TraceError(
                    self._where,
                    f"frame {n}: {name!r} moved, but it is declared fixed.",
                    fix="declare it with movable=True",
                )

    def _put_twists(self, n: int, twists: Mapping[str, tuple[ArrayLike, ArrayLike]]) -> None:
        self._known(twists, n)
        self._buffers.twist[n] = 0
        for i, name in enumerate(self._movable):
            if name in twists:
                twist = self._buffers.twist[n, i]
                twist[:3], twist[3:] = twists[name]

    def _known(self, by_name: Mapping[str, Any], n: int) -> None:
        names = [body.name for body in self.header.bodies]
        for name in by_name:
            if name not in names:
                raise TraceError(
                    self._where,
                    f"frame {n}: there is no body {name!r}.",
                    ", ".join(names),
                    "add_body before the first frame",
                )
