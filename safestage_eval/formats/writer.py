"""Recording an episode frame by frame, from any simulator or robot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from safestage_eval.episode import Body, Episode, Header, Joint, Mesh, RobotFrames, Track
from safestage_eval.errors import TraceError

from .contact_points import POINT, Contacts, GeomNames, pack, table

if TYPE_CHECKING:
    from .episode_ref import EpisodeRef

ROBOT_COLUMNS = ("joint_position", "joint_velocity", "joint_torque", "action", "gripper")

_RAW = np.dtype((np.void, POINT.itemsize))

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
        given = meshes.values() if isinstance(meshes, Mapping) else meshes
        self.meshes = {mesh.key: mesh for mesh in given}
        self._fixed: dict[str, Track] = {}
        self._room = max(1, frames)
        self._frames = 0
        self._points = 0
        self._closed = False
        self._point: NDArray[Any] = np.empty(0, POINT)
        self._states: dict[int, NDArray[np.float64]] = {}
        self._robot: dict[str, NDArray[np.float32]] = {}
        self._channels: dict[tuple[str, str], NDArray[np.float32]] = {}
        self._started = False
        self._lay_out(0, 0)

    def __len__(self) -> int:
        """T, frames so far."""
        return self._frames

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
            TraceError: after the first frame, or when the name is taken.
        """
        self._before_frames(f"body {body.name!r}")
        if any(body.name == other.name for other in self.header.bodies):
            raise TraceError(self._where, f"two bodies are named {body.name!r}")
        self.header = self.header.model_copy(update={"bodies": (*self.header.bodies, body)})
        self.meshes |= {mesh.key: mesh for mesh in meshes}
        if position is not None:
            self.set_fixed(body.name, position, orientation)

    def add_joint(self, joint: Joint) -> None:
        """Append a joint to the header. Raises TraceError after the first frame."""
        self._before_frames(f"joint {joint.name!r}")
        self.header = self.header.model_copy(update={"joints": (*self.header.joints, joint)})

    def set_fixed(
        self, name: str, position: ArrayLike, orientation: ArrayLike = (1.0, 0.0, 0.0, 0.0)
    ) -> None:
        """The one pose (m; wxyz; body frame to world) of a body that does not move.

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
                velocity (3,) rad/s), both in the world frame; or (B, 6). Without twists the
                velocities are zero.
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
        if not self._started:
            self._start(poses, robot, channels or {})
        n = self._frames
        if self._closed:
            raise TraceError(self._where, "the writer is closed: no further frames")
        if n and not t > self._t[n - 1]:
            raise TraceError(
                self._where,
                f"time does not increase at frame {n}: {self._t[n - 1]:.6f} s, then {t:.6f} s.",
                "strictly increasing timestamps",
            )
        if n == len(self._t):
            self._grow()
        try:
            if isinstance(poses, np.ndarray):
                _put(self._pose[n], poses, "poses")
            else:
                self._put_poses(n, poses)
            if twists is None:
                self._twist[n] = 0
            elif isinstance(twists, np.ndarray):
                _put(self._twist[n], twists, "twists")
            else:
                self._put_twists(n, twists)
            for name, values in zip(ROBOT_COLUMNS, robot, strict=True):
                row = self._robot[name][n]
                if values is not None:
                    _put(row, values, name)
                elif len(row):
                    raise KeyError(name)
            for key, column in self._channels.items():
                column[n] = (channels or {})[key]
        except KeyError as error:
            raise TraceError(
                self._where,
                f"frame {n}: {error.args[0]!r} is missing.",
                fix="give every frame the bodies and columns of the first one",
            ) from None
        except (ValueError, TypeError) as error:
            raise TraceError(self._where, f"frame {n}: {error}") from None
        if channels and len(channels) != len(self._channels):
            extra = sorted(set(channels) - set(self._channels))
            raise TraceError(
                self._where, f"frame {n}: channel {extra[0]} was not there at frame 0."
            )
        count = 0
        if contacts is not None and len(contacts):
            points = pack(contacts, self._names)
            count = len(points)
            while self._points + count > len(self._point):
                self._point = _doubled(self._point)
            raw, end = self._point.view(_RAW), self._points + count
            raw[self._points : end] = points.view(_RAW)  # three times faster than field by field
        self._points += count
        if state is not None:
            self._states[n] = np.array(state, np.float64).ravel()
        self._t[n] = t
        self._end[n] = self._points
        self._frames = n + 1

    def update_header(self, **fields: Any) -> None:
        """Set header fields that are known only now (``success``, ``success_time``, …).

        Raises:
            TraceError: a field that headers do not have, or bodies and joints after a frame.
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
        checked = Header.model_validate({"episode_id": "", "physics_dt": 1, "frame_dt": 1} | fields)
        self.header = self.header.model_copy(
            update={name: getattr(checked, name) for name in fields}
        )

    # ------------------------------------------------------------------ what there is so far

    def episode(self) -> Episode:
        """All frames so far, as views of the writer's buffers. Raises TraceError without frames."""
        return self.window(0, self._frames)

    def window(self, first: int, last: int) -> Episode:
        """Frames first … last − 1 as an episode, with their times as recorded.

        Raises:
            TraceError: the range is empty or not recorded yet, or a fixed body has no pose.
        """
        if not 0 <= first < last <= self._frames:
            raise TraceError(
                self._where, f"frames {first}…{last - 1} asked, {self._frames} recorded"
            )
        pose, twist = self._pose[first:last], self._twist[first:last]
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
        begin = int(self._end[first - 1]) if first else 0
        points = self._point[begin : int(self._end[last - 1])]
        counts = np.diff(self._end[first:last], prepend=begin)
        names = self._names
        return Episode(
            header=self.header,
            t=self._t[first:last],
            tracks=tracks,
            _contacts=lambda: table(points, counts, names),
            _frames=RobotFrames(*(self._robot[name][first:last] for name in ROBOT_COLUMNS)),
            meshes=self.meshes,
            channels={key: column[first:last] for key, column in self._channels.items()},
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

    def _before_frames(self, what: str) -> None:
        if self._started:
            raise TraceError(self._where, f"{what} cannot be added after the first frame")

    def _start(
        self,
        poses: Mapping[str, Pose] | NDArray[np.floating],
        robot: tuple[ArrayLike | None, ...],
        channels: Mapping[tuple[str, str], float],
    ) -> None:
        """Lay out the buffers from the first frame."""
        self._names = GeomNames(self.header)
        self._movable = tuple(body.name for body in self.header.bodies if body.movable)
        if not isinstance(poses, np.ndarray):
            for body in self.header.bodies:
                if not body.movable and body.name in poses and body.name not in self._fixed:
                    self.set_fixed(body.name, *poses[body.name])
        room = self._room
        self._lay_out(room, len(self._movable))
        for name, values in zip(ROBOT_COLUMNS, robot, strict=True):
            width = 0 if values is None else np.asarray(values).size
            self._robot[name] = np.empty((room, width), np.float32)
        self._channels = {key: np.empty(room, np.float32) for key in channels}
        self._started = True

    def _lay_out(self, room: int, bodies: int) -> None:
        self._t = np.empty(room, np.float64)
        self._end = np.empty(room, np.int64)
        self._pose = np.empty((room, bodies, 7), np.float32)
        self._twist = np.empty((room, bodies, 6), np.float32)
        self._point = np.empty(room, POINT)

    def _grow(self) -> None:
        """Twice the room. Views handed out before keep the old, now unchanging, buffers."""
        self._t, self._end = _doubled(self._t), _doubled(self._end)
        self._pose, self._twist = _doubled(self._pose), _doubled(self._twist)
        self._robot = {name: _doubled(column) for name, column in self._robot.items()}
        self._channels = {key: _doubled(column) for key, column in self._channels.items()}

    def _put_poses(self, n: int, poses: Mapping[str, Pose]) -> None:
        self._known(poses, n)
        for i, name in enumerate(self._movable):
            self._pose[n, i, :3], self._pose[n, i, 3:] = poses[name]
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
        self._twist[n] = 0
        for i, name in enumerate(self._movable):
            if name in twists:
                self._twist[n, i, :3], self._twist[n, i, 3:] = twists[name]

    def _known(self, given: Mapping[str, Any], n: int) -> None:
        names = [body.name for body in self.header.bodies]
        for name in given:
            if name not in names:
                raise TraceError(
                    self._where,
                    f"frame {n}: there is no body {name!r}.",
                    ", ".join(names),
                    "add_body before the first frame",
                )


def _put(row: NDArray[np.float32], values: ArrayLike, name: str) -> None:
    """Copy without broadcasting (one pose must not become everybody's); a number is a row of one."""
    shape = values.shape if isinstance(values, np.ndarray) else np.shape(values)
    if (shape or (1,)) != row.shape:
        raise ValueError(f"{name} has shape {shape}, expected {row.shape}")
    row[...] = values


def _doubled(array: NDArray[Any]) -> NDArray[Any]:
    bigger = np.empty((2 * len(array), *array.shape[1:]), array.dtype)
    bigger[: len(array)] = array
    return bigger
