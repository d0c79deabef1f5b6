"""Frames keep the contacts of their own step, and one of each pair that touched since the frame before."""

import numpy as np
import pytest

from safestage_record.frame_contacts import keep_contacts


@pytest.mark.parametrize("seed", range(20))
def test_what_frames_keep_is_what_going_through_the_steps_one_by_one_keeps(seed):
    rng = np.random.default_rng(seed)
    steps = int(rng.integers(1, 30))
    ends = np.flatnonzero(rng.random(steps) < 0.4) + 1
    ends = np.unique(np.append(ends, steps))
    sizes = rng.integers(0, 5, steps)
    step = np.repeat(np.arange(steps), sizes)
    pair = rng.integers(0, 4, len(step))
    normal = np.round(rng.random(len(step)) * (rng.random(len(step)) < 0.8), 3)
    kept = keep_contacts(step, pair, normal, ends)
    expected, begin = [], 0
    for frame, end in enumerate(ends):
        within = [row for row in range(len(step)) if begin <= step[row] < end]
        own = [row for row in within if step[row] == end - 1]
        earlier = {}
        for row in within:
            if pair[row] not in pair[own]:
                earlier.setdefault(pair[row], row)
        for row in [*own, *earlier.values()]:
            sums = [
                normal[[r for r in within if step[r] == s and pair[r] == pair[row]]].sum()
                for s in range(begin, end)
            ]
            expected.append((frame, row, row in own, max(sums)))
        begin = end
    found = zip(kept.frame, kept.rows, kept.own, kept.peak)
    assert np.allclose(sorted(found), sorted(expected))
    assert (np.diff(kept.frame) >= 0).all()
