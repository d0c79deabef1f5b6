"""How strongly bodies start to move: the kernels behind dependence, for one group alone."""

import numpy as np
from numpy.typing import NDArray

from safestage_eval.geometry.arrays import owned
from safestage_eval.relations.cones import balance, room_for_cones, room_for_forces
from safestage_eval.relations.reached import PATIENT, give, room_for_springs, stretch
from safestage_eval.relations.statics import Bodies, Touches, speeds, spread, weigh

F64 = NDArray[np.float64]


def motion(bodies: Bodies, touches: Touches, push: tuple[float, float] = (0.0, 0.0)) -> F64:
    """(B,) how strongly each body starts to move, in g; 0 where some forces balance.

    On each acts its weight, and ``push`` (shares of the weight along x and y) sideways.
    """
    first, second = (np.array(b, np.int64) for b in touches[:2])
    bodies, touches = Bodies(*map(owned, bodies)), Touches(first, second, *map(owned, touches[2:]))
    many, count = len(first), len(bodies.mass)
    weight, rest, out = np.empty((count, 6)), np.empty((count, 6)), np.empty(count)
    cones, forces = room_for_cones(many, count), room_for_forces(many, count)
    spread(bodies, touches, many, cones)
    weigh(bodies.mass, np.array(push), np.ones(count, np.bool_), weight)
    balance(cones, np.ones(many, np.bool_), many, forces, weight, rest)
    speeds(bodies.mass, rest, out)
    return out


def unbalanced(bodies: Bodies, touches: Touches, force: F64, push: tuple[float, float]) -> F64:
    """(B,) how strongly each body starts to move under a push, in g; 0 where it is held.

    ``force`` (C, 3) N, world: what each touch exerts on its second body so far.
    """
    count, many = len(touches.first), len(bodies.mass)
    springs, moved = room_for_springs(count, many), np.zeros(many)
    stretch(bodies, touches, force, count, springs)
    some, left = np.ones(count, np.bool_), np.ones(many, np.bool_)
    give(springs, touches, some, count, left, np.array(push), moved, PATIENT)
    return moved
