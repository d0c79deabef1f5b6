"""Whether forces within friction cones can balance a weight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

CONE_SIDES = 16
"""Edges of the pyramid that stands for a friction cone: within 2 % of its friction."""
LOST = 0.02
"""Share of the weight that may stay unbalanced: numerical noise of recorded contacts."""
ARM = 0.05
"""m: the lever by which torques are compared with forces."""

WEIGHT = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
"""Upward force and torque that balance a weight, in weights."""


def balanced(normal: F64, friction: F64, point: F64) -> bool:
    """Whether the unbalanced share of a weight is at most ``LOST``; arguments as ``unbalanced``.

    The least squares residual r over the same forces decides most cases much faster: the largest
    component of any residual is at least |r|/√6, and that of r itself is possible.
    """
    wrench = _wrenches(normal, friction, point)
    rest = _residual(wrench)
    if rest is not None:
        if np.abs(rest).max() <= LOST:
            return True
        if np.sqrt(rest @ rest) > LOST * np.sqrt(6.0):
            return False
    return _largest(wrench) <= LOST


def unbalanced(normal: F64, friction: F64, point: F64) -> float:
    """Share of a weight that no forces within the friction cones can balance; 0 if they can.

    Args:
        normal: (C, 3) unit, into the body, world.
        friction: (C,) sliding coefficients.
        point: (C, 3) m, contact points from the centre of mass, world axes.

    Minimises the largest residual of force and of torque / ``ARM``, in weights, over non-negative
    combinations of the cones' edge forces.
    """
    return _largest(_wrenches(normal, friction, point))


def _wrenches(normal: F64, friction: F64, point: F64) -> F64:
    """(6, C × CONE_SIDES) force and torque / ``ARM`` of each edge of each cone."""
    helper = np.where(np.abs(normal[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normal, first)
    angles = np.arange(CONE_SIDES) * (2 * np.pi / CONE_SIDES)
    sideways = (
        np.cos(angles)[None, :, None] * first[:, None]
        + np.sin(angles)[None, :, None] * second[:, None]
    )
    edges = normal[:, None] + friction[:, None, None] * sideways
    torque = np.cross(np.broadcast_to(point[:, None], edges.shape), edges) / ARM
    return np.asarray(np.concatenate([edges, torque], axis=2).reshape(-1, 6).T)


def _largest(wrench: F64) -> float:
    """Least possible largest component of what stays unbalanced, by linear programming."""
    from scipy.optimize import linprog  # costs as much to import as an episode to judge

    columns = wrench.shape[1]
    slack = -np.ones((6, 1))
    solved = linprog(
        np.concatenate([np.zeros(columns), [1.0]]),
        A_ub=np.block([[wrench, slack], [-wrench, slack]]),
        b_ub=np.concatenate([WEIGHT, -WEIGHT]),
        bounds=(0, None),
        method="highs",
    )
    return np.inf if solved.x is None else float(solved.x[-1])


def _residual(wrench: F64) -> F64 | None:
    """(6,) what stays unbalanced at least in the sense of least squares; None if not found.

    Non-negative least squares by active sets (Lawson & Hanson 1974, "Solving least squares
    problems", ch. 23). Its conditions for an optimum are checked before it is believed.
    """
    size = np.sqrt((wrench**2).sum(0))
    wrench = wrench / size
    share = np.zeros(wrench.shape[1])
    used = np.zeros(wrench.shape[1], np.bool_)
    rest = WEIGHT.copy()
    for _ in range(60):
        gain = wrench.T @ rest
        gain[used] = -np.inf
        best = int(gain.argmax())
        if gain[best] <= 1e-9:
            return rest
        used[best] = True
        while True:
            which = np.flatnonzero(used)
            trial = np.linalg.lstsq(wrench[:, which], WEIGHT, rcond=None)[0]
            if (trial > 0).all():
                break
            low = trial <= 0
            step = (share[which[low]] / (share[which[low]] - trial[low] + 1e-300)).min()
            share[which] += step * (trial - share[which])
            used[which[share[which] <= 1e-12]] = False
            share[~used] = 0.0
            if not used.any():
                return None
        share[:] = 0.0
        share[which] = trial
        rest = WEIGHT - wrench[:, which] @ trial
    return None
