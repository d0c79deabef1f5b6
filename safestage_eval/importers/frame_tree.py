"""The tree of coordinate frames that transforms build, sampled at common times."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import TraceError
from safestage_eval.geometry.pose import compose

from .foreign_motion import NORM

F64 = NDArray[np.float64]
Pose = tuple[F64, F64]

DEEPEST = 1000
"""Frames below one another; an arm has ten."""


@dataclass
class Samples:
    """Transforms of one frame to its parent, as they came.

    Attributes:
        parent: name of the frame that it is given in.
        time: ns, of each sample, by the clock of the recording.
        pose: x, y, z in m and w, x, y, z of each sample.
    """

    parent: str
    time: list[int] = field(default_factory=list)
    pose: list[tuple[float, ...]] = field(default_factory=list)


class Edge:
    """The motion of a frame in its parent's: sorted, of unit norm, the latest of equal times."""

    def __init__(self, name: str, samples: Samples, where: str, origin: int) -> None:
        """Times become s after ``origin`` (ns), before doubles lose their last digits.

        Raises TraceError for numbers that are not finite, or quaternions far from unit norm.
        """
        self.parent = samples.parent
        stamps = np.asarray(samples.time, np.int64) - origin
        order = np.argsort(stamps, kind="stable")
        time = stamps[order] * 1e-9
        last = np.append(np.diff(time) > 0, True)
        order, self.time = order[last], time[last]
        pose = np.asarray(samples.pose, np.float64)[order]
        self.position, turn = pose[:, :3], pose[:, 3:]
        norm = np.linalg.norm(turn, axis=1)
        off = np.flatnonzero(~(np.abs(norm - 1) < NORM) | ~np.isfinite(self.position).all(axis=1))
        if len(off):
            raise TraceError(
                where,
                f"frame {name!r}: the transform at {self.time[off[0]]:.3f} s has position "
                f"{self.position[off[0]].tolist()} and a quaternion of norm {norm[off[0]]:.4g}.",
                "finite positions, unit quaternions",
            )
        self.orientation: F64 = turn / norm[:, None]

    @property
    def moves(self) -> bool:
        """True if any two samples differ."""
        return bool(np.ptp(self.position, axis=0).any() or np.ptp(self.orientation, axis=0).any())

    def at(self, t: F64) -> Pose:
        """Interpolate (T, 3) m and (T, 4) wxyz at times (T,) s: linear in position, slerp in orientation.

        Before the first and after the last sample it stays where it was then.
        """
        from scipy.spatial.transform import Rotation, Slerp

        if len(self.time) == 1:
            return np.repeat(self.position, len(t), 0), np.repeat(self.orientation, len(t), 0)
        within = np.clip(t, self.time[0], self.time[-1])
        position = np.stack([np.interp(within, self.time, p) for p in self.position.T], axis=1)
        turns = Rotation.from_quat(self.orientation[:, [1, 2, 3, 0]])
        x, y, z, w = Slerp(self.time, turns)(within).as_quat().T
        return position, np.stack([w, x, y, z], axis=1)


class FrameTree:
    """All frames by name.

    Attributes:
        edges: frame → its motion in its parent.
        origin: ns, of the first transform, by the clock of the recording.
    """

    def __init__(self, samples: dict[str, Samples], where: str) -> None:
        """Raises TraceError for a loop, or for what ``Edge`` refuses."""
        self.origin = origin = min(min(stream.time) for stream in samples.values())
        self.edges = {name: Edge(name, stream, where, origin) for name, stream in samples.items()}
        self.where = where
        for name in self.edges:
            self.chain(name)

    @property
    def roots(self) -> list[str]:
        """Frames without a parent: the world, and frames that are not connected to it."""
        parents = dict.fromkeys(edge.parent for edge in self.edges.values())
        return [name for name in parents if name not in self.edges]

    def chain(self, name: str) -> list[str]:
        """Return the frame, its parent, …, down to the one below a root."""
        links: dict[str, None] = {}
        while name in self.edges:
            if name in links:
                raise TraceError(self.where, f"frame {name!r} is its own ancestor.", "a tree")
            if len(links) == DEEPEST:
                raise TraceError(self.where, f"more than {DEEPEST} frames below one another.")
            links[name] = None
            name = self.edges[name].parent
        return list(links)

    def root(self, name: str) -> str:
        """Return the root of a frame."""
        chain = self.chain(name)
        return self.edges[chain[-1]].parent if chain else name

    def moves(self, name: str) -> bool:
        """True if any transform between a frame and its root changes."""
        return any(self.edges[link].moves for link in self.chain(name))

    def pose(self, name: str, t: F64) -> Pose:
        """Return (T, 3) m and (T, 4) wxyz of the frame in its root, at times (T,) s."""
        pose = np.zeros((len(t), 3)), np.tile([1.0, 0, 0, 0], (len(t), 1))
        for link in reversed(self.chain(name)):
            pose = compose(*pose, *self.edges[link].at(t))
        return pose
