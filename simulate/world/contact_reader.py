"""Contacts of a MuJoCo world as a trace keeps them, read off its arrays without a Python loop."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from safestage_eval.formats import CONTACT_POINT

F64 = NDArray[np.float64]
Points = NDArray[Any]


class ContactReader:
    """Reads the contacts of each physics step, and keeps each pair's peak within a frame."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, geom_index: NDArray[np.int64]
    ) -> None:
        """``geom_index``: (ngeom,) MuJoCo geom id → where the trace counts it."""
        self._data = data
        self._geom_index = geom_index
        self._geom_body = model.geom_bodyid.astype(np.int64)
        self._pyramids = int(model.opt.cone) == int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
        self._peaks: dict[int, float] = {}
        self._seen: dict[int, Points] = {}

    def between(self) -> None:
        """A physics step that is not the frame's last: only the pairs' forces are looked at."""
        keep, normal, keys = self._touching()
        total: dict[int, float] = {}
        for key, force in zip(keys, normal.tolist(), strict=True):
            total[key] = total.get(key, 0.0) + force
        points: Points | None = None
        for key, force in total.items():
            if force > self._peaks.get(key, -1.0):
                self._peaks[key] = force
            if key not in self._seen:
                points = self._points(keep, normal) if points is None else points
                i = keys.index(key)
                self._seen[key] = points[i : i + 1]

    def frame(self) -> Points:
        """(C,) the frame's contacts, with their pairs' peak forces since the last frame.

        A pair that touched only before the frame's own step has a row without force.
        """
        keep, normal, keys = self._touching()
        total: dict[int, float] = {}
        for key, force in zip(keys, normal.tolist(), strict=True):
            total[key] = total.get(key, 0.0) + force
        points = self._points(keep, normal)
        points["peak_force"] = [max(total[key], self._peaks.get(key, 0.0)) for key in keys]
        gone = [key for key in self._seen if key not in total]
        if gone:
            extra = np.concatenate([self._seen[key] for key in gone])
            extra["force"] = 0
            extra["peak_force"] = [self._peaks[key] for key in gone]
            points = np.concatenate([points, extra])
        self._peaks.clear()
        self._seen.clear()
        return points

    def _touching(self) -> tuple[NDArray[np.intp], F64, list[int]]:
        """Contacts that push or overlap: (C,) indices, (C,) N normal force, keys of body pairs."""
        data = self._data
        contact, forces = data.contact, data.efc_force
        address = contact.efc_address
        if not len(address) or not len(forces):
            return np.zeros(0, np.intp), np.zeros(0), []
        normal = np.where(address >= 0, self._edges(np.maximum(address, 0), contact.dim)[0], 0.0)
        keep = np.flatnonzero((address >= 0) & ((normal > 0) | (contact.dist <= 0)))
        body = self._geom_body[contact.geom[keep]]
        keys = np.minimum(body[:, 0], body[:, 1]) << 20 | np.maximum(body[:, 0], body[:, 1])
        return keep, normal[keep], keys.tolist()

    def _points(self, keep: NDArray[np.intp], normal: F64) -> Points:
        """(C,) contact points with the whole force, friction included, world."""
        contact = self._data.contact
        points = np.zeros(len(keep), CONTACT_POINT)
        if not len(keep):
            return points
        row = contact.efc_address[keep]
        frame = contact.frame[keep].reshape(-1, 3, 3)
        force = normal[:, None] * frame[:, 0]
        sliding = self._edges(row, contact.dim[keep], contact.friction[keep])[1:]
        for k, along in enumerate(sliding, 1):
            force += along[:, None] * frame[:, k]
        points["position"] = contact.pos[keep]
        points["normal"] = frame[:, 0]
        points["force"] = force
        points["depth"] = -contact.dist[keep]
        geom = self._geom_index[contact.geom[keep]]
        points["geom1"], points["geom2"] = geom[:, 0], geom[:, 1]
        return points

    def _edges(
        self, row: NDArray[np.intp], dim: NDArray[np.intp], friction: F64 | None = None
    ) -> list[F64]:
        """Normal force of contacts (N), and with their ``friction`` the two tangential ones.

        With an elliptic cone the next two rows are the friction force; with a pyramid each row is
        an edge of it, two per direction (as ``mju_decodePyramid``).
        """
        forces = self._data.efc_force
        last = len(forces) - 1

        def at(k: int, least: int) -> F64:
            return np.asarray(np.where(dim >= least, forces[np.minimum(row + k, last)], 0.0))

        if not self._pyramids:
            return [at(0, 1)] + ([at(1, 3), at(2, 3)] if friction is not None else [])
        needs = (3, 3, 4, 6, 6)  # the least dimension with so many directions of friction
        pairs = [(at(2 * k, least), at(2 * k + 1, least)) for k, least in enumerate(needs)]
        normal = np.where(dim == 1, forces[row], sum(a + b for a, b in pairs))
        if friction is None:
            return [normal]
        return [normal] + [friction[:, k] * (pairs[k][0] - pairs[k][1]) for k in (0, 1)]
