"""Contacts of MuJoCo steps: copied as they are during the rollout, worked out in bulk afterwards."""

from __future__ import annotations

from typing import Any

import numpy as np

from .zip_trace import CONTACT_POINT

BATCH = 50_000
"""Contacts that wait before they are worked out: about 10 MB."""


class ContactLog:
    """Gathers contacts step by step, and makes each frame's contacts with their peak forces of them."""

    def __init__(self, model: Any, geom_index: Any, pyramidal: bool) -> None:
        """``geom_index``: (ngeom,) MuJoCo geom id → index in the trace, −1 for none."""
        self._geom_index = geom_index
        self._geom_body = model.geom_bodyid.astype(np.int64)
        self._pyramidal = pyramidal
        self._waiting: list[tuple[Any, ...]] = []
        self._frames: list[bool] = []
        self._rows = 0
        self._touching = b""
        self._same: tuple[Any, ...] = ()
        self._frame = 0
        self._done: list[tuple[Any, Any]] = []
        self.unrecorded = 0
        """Contacts of shapes that the trace does not have."""

    def take(self, data: Any) -> None:
        """Take the forces of a step between two frames.

        Where the same geoms touch as in the step before, points and normals are not copied again:
        only a pair that no frame shows has a row of such a step, and it has no force.
        """
        contact = data.contact
        geom = _geoms(contact)
        touching = geom.tobytes()
        if touching != self._touching:
            self._touching = touching
            self._same = (
                contact.dim.copy(), contact.pos.copy(), contact.frame.copy(),
                contact.friction.copy(),
            )  # fmt: skip
        self._waiting.append(
            (self._frame, geom, contact.efc_address.copy(), contact.dist.copy(),
             data.efc_force.copy(), *self._same)
        )  # fmt: skip
        self._frames.append(False)
        self._rows += len(geom)

    def take_frame(self, contacts: tuple[Any, ...]) -> None:
        """Take the contacts (``copy_contacts``) of a frame, which ends with it."""
        self._waiting.append((self._frame, *contacts))
        self._frames.append(True)
        self._rows += len(contacts[0])
        self._frame += 1
        if self._rows > BATCH:
            self._work_out()

    def finish(self) -> tuple[Any, Any]:
        """(C,) CONTACT_POINT of all frames in order, and (T,) how many each has."""
        self._work_out()
        points = [some for some, _ in self._done] or [np.zeros(0, CONTACT_POINT)]
        frames = [some for _, some in self._done] or [np.zeros(0, np.int64)]
        counts = np.bincount(np.concatenate(frames), minlength=self._frame)
        return np.concatenate(points), counts.astype(np.int64)

    def _work_out(self) -> None:
        """Turn what waits into points; steps after the last frame belong to none."""
        steps = [
            (entry, whole)
            for entry, whole in zip(self._waiting, self._frames)
            if entry[0] < self._frame and len(entry[2])
        ]
        self._waiting, self._frames, self._rows = [], [], 0
        if not steps:
            return
        number, geom, address, dist, force, dim, position, frame, friction = zip(
            *(entry for entry, _ in steps)
        )
        sizes = [len(some) for some in address]
        step = np.repeat(np.arange(len(steps)), sizes)
        starts = np.cumsum([0] + [len(some) for some in force[:-1]])
        own = np.concatenate(address).astype(np.int64)
        table = _Rows(
            geom=np.concatenate(geom),
            row=np.where(own >= 0, own + starts[step], starts[step]),
            dim=np.concatenate(dim),
            dist=np.concatenate(dist),
            position=np.concatenate(position),
            axes=np.concatenate([some.reshape(-1, 3, 3) for some in frame]),
            friction=np.concatenate(friction),
            force=np.concatenate((*force, np.zeros(1))),
            pyramidal=self._pyramidal,
        )
        normal = np.where(own >= 0, table.normal(), 0.0)
        keep = (own >= 0) & ((normal > 0) | (table.dist <= 0))
        known = (table.geom >= 0).all(axis=1)
        known[known] = (self._geom_index[table.geom[known]] >= 0).all(axis=1)
        self.unrecorded += int((keep & ~known).sum())
        rows = np.flatnonzero(keep & known)
        if not len(rows):
            return
        step, normal = step[rows], normal[rows]
        whole = np.array([flag for _, flag in steps])[step]
        at = np.array(number)[step]
        body = self._geom_body[table.geom[rows]]
        pair = body.min(axis=1) << 20 | body.max(axis=1)
        # the sum of each pair in each step, and the largest of those of each frame
        _, of_step = np.unique(step.astype(np.int64) << 40 | pair, return_inverse=True)
        sums = np.bincount(of_step.ravel(), normal)
        _, first, of_frame = np.unique(
            (at - at.min()).astype(np.int64) << 40 | pair, return_index=True, return_inverse=True
        )
        of_frame = of_frame.ravel()
        peaks = np.zeros(len(first))
        np.maximum.at(peaks, of_frame, sums[of_step.ravel()])
        # a pair that touched between two frames only has one row, without force
        there = np.bincount(of_frame, whole, len(first)) > 0
        extra = first[~there]
        chosen = np.concatenate([np.flatnonzero(whole), extra])
        chosen = chosen[np.argsort(at[chosen], kind="stable")]
        points = np.zeros(len(chosen), CONTACT_POINT)
        some = rows[chosen]
        points["position"] = table.position[some]
        points["normal"] = table.axes[some, 0]
        points["force"] = table.forces(some) * whole[chosen][:, None]
        points["peak_force"] = peaks[of_frame[chosen]]
        points["depth"] = -table.dist[some]
        geoms = self._geom_index[table.geom[some]]
        points["geom1"], points["geom2"] = geoms[:, 0], geoms[:, 1]
        self._done.append((points, at[chosen]))


class _Rows:
    """Contacts of many steps, with the constraint forces of all of them in one array."""

    def __init__(
        self,
        geom: Any,
        row: Any,
        dim: Any,
        dist: Any,
        position: Any,
        axes: Any,
        friction: Any,
        force: Any,
        pyramidal: bool,
    ) -> None:
        self.geom, self.row, self.dim, self.dist = geom, row, dim, dist
        self.position, self.axes, self.friction = position, axes, friction
        self._force, self._pyramidal = force, pyramidal

    def _at(self, k: int, least: int, some: Any) -> Any:
        """The k-th constraint force of contacts, 0 of those of a lesser dimension."""
        row = np.minimum(self.row[some] + k, len(self._force) - 1)
        return np.where(self.dim[some] >= least, self._force[row], 0.0)

    def normal(self, some: Any = slice(None)) -> Any:
        """(C,) N, normal force; of a pyramid the sum of its edges."""
        row, edges = self.row[some], 2 * (self.dim[some].astype(np.int64) - 1)
        if not self._pyramidal:
            return self._force[row]
        ends = np.minimum(row + np.maximum(edges, 1), len(self._force) - 1)
        return np.add.reduceat(self._force, np.stack([row, ends], axis=1).ravel())[::2]

    def forces(self, some: Any) -> Any:
        """(C, 3) N, the whole force on the second geom in the world (as ``mju_decodePyramid``)."""
        axes = self.axes[some]
        force = self.normal(some)[:, None] * axes[:, 0]
        for k in (0, 1):
            if self._pyramidal:
                difference = self._at(2 * k, 3, some) - self._at(2 * k + 1, 3, some)
                along = self.friction[some, k] * difference
            else:
                along = self._at(k + 1, 3, some)
            force += along[:, None] * axes[:, k + 1]
        return force


def copy_contacts(data: Any) -> tuple[Any, ...]:
    """Copy contacts and constraint forces as MuJoCo has them at this moment."""
    contact = data.contact
    return (
        _geoms(contact),
        contact.efc_address.copy(),
        contact.dist.copy(),
        data.efc_force.copy(),
        contact.dim.copy(),
        contact.pos.copy(),
        contact.frame.copy(),
        contact.friction.copy(),
    )


def _geoms(contact: Any) -> Any:
    """(C, 2) ids."""
    try:
        return contact.geom.copy()
    except AttributeError:  # before MuJoCo 3
        return np.stack([contact.geom1, contact.geom2], axis=1)
