"""How the arm of a made episode moves, and the box that it carries."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

RATE = 120.0
SHOULDER = np.array([-0.45, 0.0, 0.333])
UPPER, FORE, WRIST = 0.40, 0.42, 0.16
"""m, lengths of the arm: shoulder to elbow, elbow to wrist, wrist down to the fingertips."""

BOX = 0.03
"""m, half the edge of the boxes that are handled."""

F64 = np.ndarray

_WAY = (
    # share of the episode, fingertips m, opening
    (0.00, (-0.25, 0.10, 0.45), 1.0),
    (0.12, (-0.05, -0.28, 0.25), 1.0),
    (0.20, (-0.05, -0.28, 0.09), 1.0),
    (0.23, (-0.05, -0.28, 0.09), 0.0),
    (0.32, (-0.05, -0.28, 0.22), 0.0),
    (0.62, (0.10, 0.27, 0.22), 0.0),
    (0.72, (0.10, 0.27, 0.05), 0.0),
    (0.75, (0.10, 0.27, 0.05), 1.0),
    (0.82, (0.10, 0.27, 0.30), 1.0),
    (1.00, (0.10, 0.27, 0.30), 1.0),
)


def fingertips(t: F64) -> tuple[F64, F64, np.ndarray, int]:
    """Fingertips (T, 3) m, opening (T,), where the box is held (T,), and the frame of success."""
    share = t / t[-1]
    at = np.array([w[0] for w in _WAY])
    i = np.clip(np.searchsorted(at, share, side="right") - 1, 0, len(at) - 2)
    s = (share - at[i]) / (at[i + 1] - at[i])
    s = s * s * (3 - 2 * s)  # starts and stops at rest
    place = np.array([w[1] for w in _WAY])
    hand = place[i] + s[:, None] * (place[i + 1] - place[i])
    gap = np.array([w[2] for w in _WAY])
    opening = gap[i] + s * (gap[i + 1] - gap[i])
    held = (share >= 0.23) & (share < 0.72)
    return hand, opening, held, int(np.argmax(share >= 0.86))


def carried(start: F64, hand: F64, held: np.ndarray) -> F64:
    """(T, 3) m: with the hand while held, then where it was let go."""
    offset = start - hand[np.argmax(held)]
    last = len(held) - 1 - int(np.argmax(held[::-1]))
    path = np.where(held[:, None], hand + offset, start)
    path[last + 1 :] = path[last]
    return path


def arm(hand: F64, opening: F64) -> dict[str, tuple[F64, Rotation]]:
    """Link → positions (T, 3) m and orientations: two long bones that reach the wrist."""
    wrist = hand + np.array([0.0, 0.0, WRIST])
    way = wrist - SHOULDER
    yaw = np.arctan2(way[:, 1], way[:, 0])
    flat, up = np.hypot(way[:, 0], way[:, 1]), way[:, 2]
    reach = np.minimum(np.hypot(flat, up), 0.999 * (UPPER + FORE))
    bend = np.arccos((UPPER**2 + reach**2 - FORE**2) / (2 * UPPER * reach))
    lift = np.arctan2(up, flat) + bend
    turn = Rotation.from_euler("z", yaw[:, None])
    upper = turn * Rotation.from_euler("y", (np.pi / 2 - lift)[:, None])
    elbow = SHOULDER + upper.apply([0, 0, UPPER])
    along = wrist - elbow
    pitch = np.arctan2(np.hypot(along[:, 0], along[:, 1]), along[:, 2])
    fore = turn * Rotation.from_euler("y", pitch[:, None])
    half = 0.01 + 0.03 * opening[:, None] + BOX * (opening[:, None] < 0.5)
    still = np.broadcast_to(SHOULDER, hand.shape)
    side = np.array([0.0, 1.0, 0.0])
    return {
        "link1": (still - [0, 0, 0.10], turn),
        "link2": (still, upper),
        "link3": (SHOULDER + upper.apply([0, 0, 0.6 * UPPER]), upper),
        "link4": (elbow, fore),
        "link5": (elbow + fore.apply([0, 0, 0.4 * FORE]), fore),
        "link6": (wrist, turn),
        "link7": (wrist - [0, 0, 0.04], turn),
        "hand": (wrist - [0, 0, 0.09], Rotation.identity(len(hand))),
        "left_finger": (hand + half * side, Rotation.identity(len(hand))),
        "right_finger": (hand - half * side, Rotation.identity(len(hand))),
    }


def tracks(paths: list[tuple[F64, Rotation]]) -> tuple[F64, F64]:
    """(T, B, 7) poses and (T, B, 6) twists of bodies on their paths."""
    poses, twists = [], []
    for position, turn in paths:
        spin = np.zeros_like(position)
        spin[1:] = (turn[1:] * turn[:-1].inv()).as_rotvec() * RATE
        xyzw = turn.as_quat()
        poses.append(np.concatenate([position, xyzw[:, 3:], xyzw[:, :3]], 1))
        twists.append(np.concatenate([np.gradient(position, 1 / RATE, axis=0), spin], 1))
    return np.stack(poses, 1).astype(np.float32), np.stack(twists, 1).astype(np.float32)
