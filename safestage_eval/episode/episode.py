"""The episode: one rollout, whole, as everything downstream reads it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .body import Body
from .clock import Clock
from .contacts import ContactTable
from .content_hash import content_hash
from .frames import RobotFrames
from .header import Header
from .mesh import Mesh
from .track import Track


@dataclass(frozen=True, eq=False)
class Episode:
    """One rollout, read-only. Columns may be loaded from disk when they are first asked for.

    Attributes:
        header: everything that is said once.
        t: (T,) s from the episode's start, strictly increasing.
        tracks: body name → its motion; fixed bodies have a single row.
        meshes: mesh key → mesh, for the geoms that have one.
        channels: (body name, channel name) → (T,) optional recorded scalars.
        states: frame → (N,) full integration state of the simulator, for exact re-simulation.
        attachments: file name → bytes that came with the episode (its task file, say).
        path: the file it was read from, if any.
        unseen: (T,) frames that the evaluator put in where nothing was recorded (``seen``), at which
            nothing is known; None where there are none.
        recorded: the episode without these frames, if there are any.
        doubtful: (body, column) that contradict others and were made unknown (``doubtful_columns``).

    NaN stands for what was not measured. Contacts and frames are given as tables, or as functions that load them when first asked.
    """

    header: Header
    t: NDArray[np.float64]
    tracks: Mapping[str, Track]
    _contacts: ContactTable | Callable[[], ContactTable] | None = field(default=None, repr=False)
    _frames: RobotFrames | Callable[[], RobotFrames] | None = field(default=None, repr=False)
    meshes: Mapping[str, Mesh] = field(default_factory=dict, repr=False)
    channels: Mapping[tuple[str, str], NDArray[np.float32]] = field(
        default_factory=dict, repr=False
    )
    states: Mapping[int, NDArray[np.float64]] = field(default_factory=dict, repr=False)
    attachments: Mapping[str, bytes] = field(default_factory=dict, repr=False)
    path: Path | None = None
    unseen: NDArray[np.bool_] | None = None
    recorded: Episode | None = field(default=None, repr=False)
    doubtful: frozenset[tuple[str, str]] = frozenset()

    def __len__(self) -> int:
        """T, the number of frames."""
        return len(self.t)

    @cached_property
    def contacts(self) -> ContactTable:
        """All contacts, in canonical order. Raises TraceError when stored ones are broken."""
        given = self._contacts
        if given is None:
            return ContactTable.empty()
        return given() if callable(given) else given

    @cached_property
    def frames(self) -> RobotFrames:
        """Joint state and commands. Raises TraceError when stored ones are broken."""
        given = self._frames
        if given is None:
            return RobotFrames.empty(len(self))
        return given() if callable(given) else given

    @cached_property
    def bodies(self) -> dict[str, Body]:
        """Name → body, in the header's order."""
        return {body.name: body for body in self.header.bodies}

    @cached_property
    def body_index(self) -> dict[str, int]:
        """Name → index in ``header.bodies``, as used in the contact table."""
        return {body.name: i for i, body in enumerate(self.header.bodies)}

    @cached_property
    def geom_owner(self) -> NDArray[np.int16]:
        """(G,) index of the body each geom belongs to."""
        return np.repeat(
            np.arange(len(self.header.bodies), dtype=np.int16),
            [len(body.geoms) for body in self.header.bodies],
        )

    def track(self, name: str) -> Track:
        """The motion of a body over all T frames (a fixed body's row repeated)."""
        return self.tracks[name].over(len(self))

    @cached_property
    def dt(self) -> float:
        """s, spacing of frames: the mean time step (``frame_dt`` if T < 2).

        The median where a pause in the recording pulls the mean away from it.
        """
        if self.recorded is not None:
            return self.recorded.dt
        if len(self.t) < 2:
            return self.header.frame_dt
        mean = float(self.t[-1] - self.t[0]) / (len(self.t) - 1)
        steps = self.t[1:] - self.t[:-1]
        least, most = float(steps.min()), float(steps.max())
        if mean - least < 0.05 * least and most - mean < 0.05 * least:
            return mean  # wherever the median lies between the two
        median = float(np.median(steps))
        return mean if abs(mean - median) < 0.05 * median else median

    @cached_property
    def clock(self) -> Clock:
        """How long its samples last, and how many of them make up a duration."""
        return Clock(self.t, self.dt, self.unseen)

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 over the physical data (docs/traces.md): the same in every format."""
        if self.recorded is not None:
            return self.recorded.content_hash
        e = self
        return content_hash(e.header, e.t, e.tracks, e.contacts, e.frames, e.channels)

    @property
    def trace_hash(self) -> str:
        """The same, as results state it."""
        return self.content_hash


def with_header(episode: Episode, header: Header) -> Episode:
    """Return the recording under another header; the content hash stays."""
    changed = replace(episode, header=header)
    vars(changed)["content_hash"] = episode.content_hash
    return changed
