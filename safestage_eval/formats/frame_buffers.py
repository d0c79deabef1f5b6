"""Growing arrays that frames are appended to and stretches of frames are taken from."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .contact_points import POINT, RAW

ROBOT_COLUMNS = ("joint_position", "joint_velocity", "joint_torque", "action", "gripper")


class FrameBuffers:
    """The columns of a recording, by frame. They double when full.

    What lies before ``length`` never changes, and doubling leaves the old arrays as they are:
    views of them stay what they were.

    Attributes:
        length: T, frames that are complete.
        t: s, of each frame.
        pose: (…, B, 7) position m and orientation wxyz of the movable bodies.
        twist: (…, B, 6) linear m/s and angular rad/s velocity.
        robot: column → (…, width).
        channels: (body, name) → (…,).
        end: (…,) contact points up to and with each frame.
        points: (…,) POINT, of all frames in a row.
    """

    def __init__(
        self,
        room: int,
        bodies: int,
        widths: Iterable[int],
        channels: Iterable[tuple[str, str]],
    ) -> None:
        self.length = 0
        self.t = np.empty(room, np.float64)
        self.pose = np.empty((room, bodies, 7), np.float32)
        self.twist = np.empty((room, bodies, 6), np.float32)
        self.robot = {
            name: np.empty((room, width), np.float32)
            for name, width in zip(ROBOT_COLUMNS, widths, strict=True)
        }
        self.channels = {key: np.empty(room, np.float32) for key in channels}
        self.end = np.empty(room, np.int64)
        self.points: NDArray[Any] = np.empty(room, POINT)

    def make_room(self) -> int:
        """Make room for one more frame; return its number."""
        if self.length == len(self.t):
            self.t, self.end = doubled(self.t), doubled(self.end)
            self.pose, self.twist = doubled(self.pose), doubled(self.twist)
            self.robot = {name: doubled(column) for name, column in self.robot.items()}
            self.channels = {key: doubled(column) for key, column in self.channels.items()}
        return self.length

    def finish_frame(self, t: float, points: NDArray[Any] | None) -> None:
        """Complete a frame whose other columns are filled with its time (s) and contacts."""
        n = self.length
        begin = end = int(self.end[n - 1]) if n else 0
        if points is not None:
            end += len(points)
            while end > len(self.points):
                self.points = doubled(self.points)
            # as raw bytes: three times faster than field by field
            self.points.view(RAW)[begin:end] = points.view(RAW)
        self.t[n], self.end[n] = t, end
        self.length = n + 1

    def contacts(self, first: int, last: int) -> tuple[NDArray[Any], NDArray[np.int64]]:
        """Return the (C,) points of frames first … last − 1, and their number (T,) in each."""
        begin = int(self.end[first - 1]) if first else 0
        counts = np.diff(self.end[first:last], prepend=begin)
        return self.points[begin : int(self.end[last - 1])], counts


def put(row: NDArray[np.float32], values: ArrayLike, name: str) -> None:
    """Copy without broadcasting (one pose must not become everybody's); a number is a row of one.

    What is too large for float32 becomes infinite, which no trace may hold; NumPy warns of it.

    Raises:
        ValueError: the shapes differ.
    """
    shape = values.shape if isinstance(values, np.ndarray) else np.shape(values)
    if (shape or (1,)) != row.shape:
        raise ValueError(f"{name} has shape {shape}, expected {row.shape}")
    row[...] = values


def doubled(array: NDArray[Any]) -> NDArray[Any]:
    """Return a copy with room for as many rows again."""
    bigger = np.empty((2 * len(array), *array.shape[1:]), array.dtype)
    bigger[: len(array)] = array
    return bigger
