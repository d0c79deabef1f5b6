"""Contacts of a MuJoCo world as a trace keeps them."""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from safestage_eval.formats import CONTACT_POINT

Points = NDArray[Any]
F64 = NDArray[np.float64]

EDGES = np.repeat([3, 3, 4, 6, 6], 2)
"""From how many dimensions on a contact has each edge of a friction pyramid."""


class Step(NamedTuple):
    """MuJoCo's arrays after a physics step with C contacts, copied.

    Attributes:
        dist: (C,) m.
        geom: (C, 2) MuJoCo ids.
        pos: (C, 3) m.
        frame: (C, 9) unit: normal and two tangents.
        friction: (C, 5).
        dim: (C,) of the contact's force.
        row: (C,) where its force begins among all; negative: it has none.
        forces: N, the constraint forces, and zeros after them.
    """

    dist: F64
    geom: NDArray[np.int32]
    pos: F64
    frame: F64
    friction: F64
    dim: NDArray[np.int32]
    row: NDArray[np.int32]
    forces: F64


class ContactReader:
    """Reads the contacts of each physics step, and keeps each pair's peak within a frame."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, geom_index: NDArray[np.int64]
    ) -> None:
        """``geom_index``: (ngeom,) MuJoCo geom id → where the trace counts it."""
        self._data, self._index = data, geom_index
        self._body = model.geom_bodyid.astype(np.int64)
        self._pyramids = int(model.opt.cone) == int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
        self._steps: list[Step] = []

    def between(self) -> None:
        """A physics step that is not the frame's last: only the pairs' forces are looked at."""
        self._steps.append(self._read())

    def frame(self) -> Points:
        """(C,) the frame's contacts, with their pairs' peak forces since the last frame.

        A contact counts if it pushes or overlaps. A pair that touched only before the frame's own step
        has a row without force.
        """
        steps, self._steps = [*self._steps, self._read()], []
        step = np.repeat(np.arange(len(steps)), [len(each.row) for each in steps])
        whole = Step(*map(np.concatenate, zip(*steps, strict=True)))
        begin = np.cumsum([0, *(len(each.forces) for each in steps[:-1])])
        force = self._force(whole, np.where(whole.row < 0, -1, whole.row + begin[step]))
        counts = np.flatnonzero((whole.row >= 0) & ((force[:, 0] > 0) | (whole.dist <= 0)))
        dist, geom, pos, frame = (values[counts] for values in whole[:4])
        step, force = step[counts], force[counts]
        points = np.zeros(len(counts), CONTACT_POINT)
        points["position"], points["normal"], points["depth"] = pos, frame[:, :3], -dist
        points["force"] = (
            force[:, :1] * frame[:, :3]
            + force[:, 1:2] * frame[:, 3:6]
            + force[:, 2:] * frame[:, 6:]
        )
        points["geom1"], points["geom2"] = self._index[geom].T
        one, other = np.sort(self._body[geom], axis=1).T
        _, first, pair = np.unique(one << 20 | other, return_index=True, return_inverse=True)
        total = np.bincount(pair * len(steps) + step, force[:, 0], len(first) * len(steps))
        points["peak_force"] = total.reshape(len(first), len(steps)).max(axis=1, initial=0.0)[pair]
        own = np.flatnonzero(step == len(steps) - 1)
        before = np.sort(np.delete(first, pair[own]))
        points["force"][before] = 0.0
        return np.asarray(points[np.concatenate([own, before])])

    def _read(self) -> Step:
        contact, forces = self._data.contact, self._data.efc_force
        row = contact.efc_address if len(forces) else np.full(len(contact.dim), -1, np.int32)
        return Step(
            contact.dist.copy(), contact.geom.copy(), contact.pos.copy(), contact.frame.copy(),
            contact.friction.copy(), contact.dim.copy(), row.copy(),
            np.append(forces, np.zeros(len(EDGES))),
        )  # fmt: skip

    def _force(self, contacts: Step, row: NDArray[np.integer]) -> F64:
        """(C, 3) N, along the normal and both tangents; ``row``: among the forces of all steps.

        With an elliptic cone the rows of the force are normal and friction; with a pyramid each is an
        edge of it, two per direction (as ``mju_decodePyramid``).
        """
        dim, forces = contacts.dim, contacts.forces
        if not self._pyramids:
            there = dim[:, None] >= [1, 3, 3]
            return np.asarray(np.where(there, forces[row[:, None] + np.arange(3)], 0.0))
        edges = np.where(dim[:, None] >= EDGES, forces[row[:, None] + np.arange(len(EDGES))], 0.0)
        out = np.empty((len(row), 3))
        out[:, 0] = np.where(dim == 1, forces[row], edges.sum(axis=1))
        out[:, 1:] = contacts.friction[:, :2] * (edges[:, [0, 2]] - edges[:, [1, 3]])
        return out
