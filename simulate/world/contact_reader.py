"""Contacts of a MuJoCo world as a trace keeps them, read off its arrays without a Python loop."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from .contact_kernel import Gathered, gather

Points = NDArray[Any]


class ContactReader:
    """Reads the contacts of each physics step, and keeps each pair's peak within a frame."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, geom_index: NDArray[np.int64]
    ) -> None:
        """``geom_index``: (ngeom,) MuJoCo geom id → where the trace counts it."""
        self._data = data
        self._facts = (
            int(model.opt.cone) == int(mujoco.mjtCone.mjCONE_PYRAMIDAL),
            model.geom_bodyid.astype(np.int64),
            geom_index.astype(np.int64),
        )
        self._room = Gathered.of(256)

    def between(self) -> None:
        """A physics step that is not the frame's last: only the pairs' forces are looked at."""
        self._gather(last=False)

    def frame(self) -> Points:
        """(C,) the frame's contacts, with their pairs' peak forces since the last frame.

        A pair that touched only before the frame's own step has a row without force.
        """
        count = self._gather(last=True)
        return self._room.points[:count].copy()

    def _gather(self, *, last: bool) -> int:
        contact, forces, room = self._data.contact, self._data.efc_force, self._room
        address = contact.efc_address if len(forces) else np.zeros(0, np.int32)
        needed = len(address) + int(room.known[0])
        if needed > len(room.points):
            self._room = room = room.wider(2 * needed)
        return int(
            gather(
                address, contact.dim, contact.geom, contact.dist, contact.pos, contact.frame,
                contact.friction, forces, *self._facts, room.numbers, room.ids, room.pair, room.pairs,
                room.total, room.seen, room.seen_pair, room.peak, room.known, last,
            )
        )  # fmt: skip
