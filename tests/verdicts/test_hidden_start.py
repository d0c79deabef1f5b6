"""A change since a touch that is one of several: whichever it was, the bounds hold it."""

import numpy as np
import pytest

from safestage_eval.evidence.reference import Baseline, Reference
from safestage_eval.evidence.series import Series, exact
from safestage_eval.verdicts import hidden_start

FRAMES, LIMIT = 80, 0.01


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("step", [1e-5, 1e-3, 1e-2])
def test_the_bounds_hold_the_change_since_every_possible_start(seed: int, step: float) -> None:
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.normal(0, step, (FRAMES, 3)), axis=0)
    possible = np.arange(FRAMES) >= rng.integers(0, 40)
    possible &= rng.random(FRAMES) < rng.choice([0.2, 1.0])
    possible[60] = True

    def measured(reference: Reference) -> Series:
        return exact(np.linalg.norm(path - reference.of(path, path[0]), axis=1), "length")

    found = hidden_start.since_some(measured, Baseline(), possible, LIMIT)
    for start in possible.nonzero()[0]:
        change = measured(hidden_start.before(Baseline(), int(start), FRAMES)).lower[start:]
        assert (found.lower[start:] <= change + 1e-12).all()
        assert (change <= found.upper[start:] + 1e-12).all()


def test_what_did_not_move_is_known_as_well_as_it_lay_still() -> None:
    path = np.full((FRAMES, 3), 0.5)

    def measured(reference: Reference) -> Series:
        return exact(np.linalg.norm(path - reference.of(path, path[0]), axis=1), "length")

    found = hidden_start.since_some(measured, Baseline(), np.ones(FRAMES, np.bool_), LIMIT)
    assert not found.upper.any()
