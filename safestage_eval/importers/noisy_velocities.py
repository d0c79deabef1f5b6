"""Recorded velocities that contradict smooth poses: the poses win.

PhysX reports velocities of bodies at rest or in a hand that shake by centimetres per second while their poses do not
move (Isaac Lab). Other mistakes (another unit, another frame, a shift in time) leave velocities as smooth as the
poses, and are not mended here: the audit names them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode, Track

from .account import Account
from .map_tables import MapFile

NOISE = 0.02
"""m/s by which recorded velocities differ from those of the poses (root mean square) before they are doubted."""

SHARE = 0.5
"""The same, as a share of the velocities of the poses."""

ROUGHER = 3.0
"""How many times more noisy velocities vary from frame to frame than those of the poses."""

ALIKE = 0.9
"""Correlation with the poses' velocities above which they are those in another unit."""


def believe_poses(episode: Episode, map_: MapFile, account: Account) -> Episode:
    """Return the episode without the velocities that its poses contradict, so that they are derived.

    The map file's ``velocities`` decides for all bodies; without it each moving body is looked at.
    """
    stated = map_.source.velocities
    if stated == "recorded":
        return episode
    noisy = [
        name
        for name, track in episode.tracks.items()
        if len(track.position) > 1 and (stated is not None or is_noisy(episode.t, track))
    ]
    noisy = [name for name in noisy if _recorded(episode.tracks[name])]
    if not noisy:
        return episode
    account.recomputed(
        f"velocities of {', '.join(noisy)}",
        "by differences of poses, as the map file says"
        if stated is not None
        else "by differences of poses, which are smooth and which the recorded velocities contradict",
        remedy=""
        if stated
        else 'velocities = "recorded" under [source] of the map file keeps them',
    )
    tracks = {**episode.tracks, **{name: _without(episode.tracks[name]) for name in noisy}}
    return replace(episode, tracks=tracks, _contacts=episode.contacts, _frames=episode.frames)


def is_noisy(t: NDArray[np.float64], track: Track) -> bool:
    """True where velocities contradict the differences of poses, and vary far more than these."""
    if len(t) < 4 or len(track.position) != len(t):
        return False
    with np.errstate(divide="ignore", invalid="ignore"):  # two rows of one time
        moved = np.diff(track.position.astype(np.float64), axis=0) / np.diff(t)[:, None]
    said = track.linear_velocity.astype(np.float64)
    said = (said[:-1] + said[1:]) / 2
    known = np.isfinite(moved).all(axis=1) & np.isfinite(said).all(axis=1)
    moved, said = moved[known], said[known]
    if len(moved) < 3:
        return False
    off, speed = _rms(said - moved), _rms(moved)
    if off < max(NOISE, SHARE * speed):
        return False
    both = _rms(said) * speed
    if both and float((said * moved).sum(axis=1).mean()) / both > ALIKE:
        return False
    return _rms(np.diff(said, axis=0)) > ROUGHER * _rms(np.diff(moved, axis=0))


def _rms(rows: NDArray[np.float64]) -> float:
    return float(np.sqrt((rows**2).sum(axis=1).mean()))


def _recorded(track: Track) -> bool:
    return bool(track.linear_velocity.any() or track.angular_velocity.any())


def _without(track: Track) -> Track:
    none = np.zeros_like(track.linear_velocity)
    return Track(track.position, track.orientation, none, none)
