"""Peaks of forces between two samples: never small where a larger one may have been missed."""

from dataclasses import replace

import numpy as np
import pytest
from resampled import resampled
from scenes import Scene

from safestage_eval.episode import Episode, Geom
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations

DENSE, BEGIN, LASTS = 480, 1.0, 0.3


def tapped(hardest: float, times: int = 1) -> Episode:
    """A fingertip comes to a vase, leans on it with 2 N, once harder for 10 ms, and goes; 480 Hz."""
    frames = round((BEGIN + times * 2 * LASTS + 0.5) * DENSE)
    scene = Scene(frames, DENSE)
    since = np.mod(scene.t - BEGIN, 2 * LASTS)
    during = (scene.t >= BEGIN) & (scene.t < BEGIN + times * 2 * LASTS)
    touching = during & (since < LASTS)
    away = np.where(during, np.maximum(np.minimum(since - LASTS, 2 * LASTS - since), 0), 1.0)
    away = np.minimum(np.where(during, away, np.abs(scene.t - BEGIN)), 0.2) * 0.3
    path = np.column_stack([0.06 + away, np.zeros((frames, 2))])
    scene.fixed("vase", geoms=(Geom(kind="box", size=(0.05,) * 3),), kind="object")
    scene.body("tip", Geom(kind="sphere", size=(0.01,)), path, kind="gripper")
    for frame in np.flatnonzero(touching):
        hard = BEGIN + 0.1 <= scene.t[frame] < BEGIN + 0.11
        force = hardest if hard else 2.0
        scene.contact(
            "tip", "vase", (0.05, 0, 0), (-force, 0, 0), (-1, 0, 0), slice(frame, frame + 1)
        )
    return scene.episode()


def with_all_peaks(whole: Episode, step: int, phase: int) -> Episode:
    """Every ``step``-th frame, with the peaks of the frames left out, as a recorder keeps them."""
    at = np.arange(phase, len(whole), step)
    seen = resampled(whole, at)
    force = np.zeros(len(whole))
    force[whole.contacts.frame] = whole.contacts.peak_force
    peaks = np.array([force[max(k - step + 1, 0) : k + 1].max() for k in at])
    rows = np.flatnonzero(peaks)
    first = whole.contacts.where(np.zeros(len(rows), np.intp))
    still = force[at[rows]]
    contacts = replace(
        first,
        frame=rows.astype(np.int32),
        force=np.float32(still[:, None] * first.normal),
        peak_force=np.float32(peaks[rows]),
    )
    return replace(seen, _contacts=contacts)


def peak(episode: Episode) -> tuple[float, float]:
    found = Relations(Signals(episode)).signal("peak_force", ("tip", "vase"))
    return float(found.lower.max()), float(found.upper.max())


@pytest.mark.parametrize("step", [2, 8, 24, 48])
def test_frames_left_out_leave_the_peak_open(step: int) -> None:
    whole = tapped(40.0)
    assert peak(whole) == (40.0, 40.0)
    hit = (whole.t >= BEGIN + 0.1) & (whole.t < BEGIN + 0.11)
    for phase in range(0, step, 3):
        at = np.arange(phase, len(whole), step)
        found = Relations(Signals(resampled(whole, at))).signal("peak_force", ("tip", "vase"))
        behind = np.searchsorted(at, np.flatnonzero(hit))
        assert (found.lower[behind] <= 40.0).all(), phase
        assert (found.upper[behind] >= 40.0).all(), phase


@pytest.mark.parametrize("step", [4, 8, 24])
def test_peaks_over_all_steps_are_taken_at_their_word(step: int) -> None:
    for hardest in (2.0, 40.0):
        for phase in (1, 2, 3):
            assert peak(with_all_peaks(tapped(hardest, times=3), step, phase)) == (hardest,) * 2


def test_a_hand_that_stays_away_has_not_pressed() -> None:
    whole = tapped(40.0)
    away = np.flatnonzero(whole.t < BEGIN - 0.1)
    assert peak(resampled(whole, away[::24])) == (0.0, 0.0)
