"""What relations tell, as tests ask for it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from safestage_eval.relations.relations import Relations


def holds(
    relations: Relations,
    name: str,
    bodies: Sequence[str],
    frames: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """(T,) a relation certainly holds; ``frames`` (T,): where it is asked for, everywhere if None."""
    return np.asarray(relations.told(name, bodies, frames).lower == 1)


def doubt_of(
    relations: Relations, name: str, bodies: Sequence[str]
) -> tuple[NDArray[np.bool_], str] | None:
    """(T,) where the trace does not tell it, and why; None where it tells all."""
    told = relations.told(name, bodies)
    open_ = told.lower < told.upper
    return (np.asarray(open_), told.notes[-1]) if open_.any() else None


def why_unknown(relations: Relations, name: str, bodies: Sequence[str]) -> str:
    """Why nothing is known of a relation."""
    told = relations.told(name, bodies)
    assert (told.lower == 0).all()
    assert (told.upper == 1).all()
    return told.notes[-1]
