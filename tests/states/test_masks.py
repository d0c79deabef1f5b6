"""Which frames are looked at for others."""

import numpy as np

from safestage_eval.states.masks import followed, last_of, sample, widened


def drawn():
    rng = np.random.default_rng(3)
    for frames in (1, 2, 17, 60):
        for share in (0.0, 0.1, 0.5, 1.0):
            yield rng.random(frames) < share


def test_every_run_with_a_wanted_frame_has_a_sampled_one():
    for wanted in drawn():
        for every in (1, 2, 3, 12):
            some = sample(wanted, every)
            assert not (some & ~wanted).any()
            for start in range(1 - every, len(wanted)):
                run = slice(max(start, 0), start + every)
                assert some[run].any() == wanted[run].any()


def test_so_many_frames_before_and_after():
    for frames in drawn():
        at = frames.nonzero()[0]
        for by in (0, 1, 5):
            near = [((at >= i - by) & (at <= i + by)).any() for i in range(len(frames))]
            after = [((at >= i - by) & (at <= i)).any() for i in range(len(frames))]
            assert widened(frames, by).tolist() == near
            assert followed(frames, by).tolist() == after
        assert last_of(frames) == max((i + 1 for i in at), default=0)
