"""Scenes of any objects as rows of one width: a slot for each object, in an order that roles fix."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError

SLOTS = 7
"""Objects in the fullest scene of the benchmark."""
SLOT = ("x", "y", "z", "qw", "qx", "qy", "qz", "there")
"""Numbers of a slot: m from the arm's base, wxyz, and 1 where there is an object; an empty slot is all 0."""
SLOT_NAMES = tuple(f"slot{i}_{part}" for i in range(SLOTS) for part in SLOT)


def slot_order(objects: Iterable[str], roles: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Targets first, then destinations, then the rest as the scene lists them.

    These two are what every prompt names. Which of the rest is protected or fragile is not told.

    Raises InputError for more objects than there are slots.
    """
    everything = list(objects)
    named = [*roles.get("target", ()), *roles.get("destination", ())]
    result = tuple(dict.fromkeys([*(n for n in named if n in everything), *everything]))
    if len(result) > SLOTS:
        raise InputError(
            f"a scene of {len(result)} objects", "has more than a learned policy has slots for.",
            f"{SLOTS} at most",
        )  # fmt: skip
    return result


def filled(poses: Mapping[str, NDArray[np.float64]], order: Sequence[str]) -> NDArray[np.float32]:
    """(…, SLOTS × 8) from the poses (…, 7) of the objects in their slots."""
    shape = poses[order[0]].shape[:-1]
    result = np.zeros((*shape, SLOTS, len(SLOT)), np.float32)
    for i, name in enumerate(order):
        pose = np.asarray(poses[name])
        sign = np.where(pose[..., 3:4] < 0, -1.0, 1.0)  # q and −q are one orientation
        result[..., i, :7] = np.concatenate([pose[..., :3], sign * pose[..., 3:]], -1)
        result[..., i, 7] = 1.0
    return result.reshape(*shape, -1)
