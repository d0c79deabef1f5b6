"""Bodies that fall together, against a slow step-by-step computation."""

import numpy as np
from balances import unbalanced
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.relations.collapse import EASED, PUSHES, STILL, TIPS, Pile, collapse
from safestage_eval.relations.cones import COMPLIANCE, CONE_SIDES, TOLERANCE
from safestage_eval.relations.statics import LOST, Bodies, Touches

FRAMES = 2


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=40)
def test_a_collapse_is_found_as_step_by_step(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pile = random_pile(rng)
    body = int(rng.integers(0, len(pile.mass)))
    removed = int(rng.integers(-1, len(pile.mass)))
    if removed == body:
        removed = -1
    off = rng.random(len(pile.owner)) < 0.2
    push, fallen = collapse(pile, body, removed, off)
    for frame in range(FRAMES):
        first, gone, clear = slowly(pile, frame, body, removed, off)
        if clear:  # nothing moves by nearly LOST
            assert push[frame] == first
            assert set(np.flatnonzero(fallen[frame])) == gone


def random_pile(rng: np.random.Generator) -> Pile:
    """Up to five bodies that touch each other and the ground, which may be a part of one of them."""
    bodies, pairs = int(rng.integers(1, 6)), int(rng.integers(1, 9))
    owner = np.stack([rng.integers(-1, bodies, pairs), rng.integers(0, bodies, pairs)], 1)
    owner = np.where(rng.random((pairs, 1)) < 0.5, owner, owner[:, ::-1])
    hinged = (owner < 0) & (rng.random((pairs, 2)) < 0.2)
    part = np.where(hinged, rng.integers(0, bodies, (pairs, 2)), owner)
    counts = rng.integers(0, 6, (pairs, FRAMES))
    start = np.pad(counts, ((0, 0), (1, 0))).cumsum().reshape(pairs, -1)
    points = int(counts.sum())
    normal = rng.normal(size=(points, 3)) * 0.4
    normal[:, 2] += np.repeat(np.where(owner[:, 1] < owner[:, 0], -1.0, 1.0), counts.sum(1))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    spread = rng.normal(size=(FRAMES, bodies, 3, 3)) * 0.04
    return Pile(
        rng.uniform(0.1, 2.0, bodies),
        rng.uniform(-0.03, 0.03, (FRAMES, bodies, 3)),
        spread @ spread.swapaxes(2, 3) + 1e-4 * np.eye(3),
        owner,
        part,
        start,
        rng.uniform(-0.1, 0.1, (points, 3)),
        normal,
        rng.uniform(0.0, 1.2, points),
        normal * rng.uniform(0.0, 5.0, (points, 1)),
    )


def slowly(pile: Pile, frame: int, body: int, removed: int, off: np.ndarray) -> tuple:
    """The first push that makes the body fall, −1 if none; what falls; whether it is clear."""
    pairs = np.flatnonzero(pile.start[:, frame] < pile.start[:, frame + 1])
    group = linked({body}, pile, pairs)
    pairs = [p for p in pairs if group & set(pile.owner[p])]
    clear, balanced = True, []
    for k, push in enumerate(PUSHES):
        gone, sure = falling(pile, frame, removed, off, group, pairs, push, tips=False)
        clear &= sure
        if body in gone:
            return k, gone, clear
        balanced.append(gone)
    for k, push in enumerate(PUSHES):
        gone = set(balanced[0])
        before = given(pile, frame, group, pairs, push)
        while True:
            away = [p for p in pairs if off[p] or gone & set(pile.part[p])]
            rest = [p for p in pairs if p not in away]
            rocked = {int(b) for p in away for b in pile.owner[p]} - gone - {-1}
            left = linked(rocked, pile, rest)
            bear = [p for p in rest if left & set(pile.owner[p])]
            moved = given(pile, frame, left, bear, push)
            fallen = {b for b in left if moved[b] > LOST}
            clear &= all(abs(moved[b] - LOST) > 1e-4 for b in left)
            if not fallen:
                break
            clear &= all(abs(before[b] - LOST) > 1e-4 for b in group)
            if max(before.values()) > LOST:
                break
            gone |= fallen
        if body in gone:
            return k, gone, clear
    for k, push in enumerate(PUSHES):
        gone, sure = falling(pile, frame, removed, off, group, pairs, push, tips=True)
        clear &= sure
        if body in gone:
            return k, gone, clear
    return -1, set(), clear


def falling(
    pile: Pile, frame: int, removed: int, off: np.ndarray, group: set[int], pairs, push, *, tips
) -> tuple[set[int], bool]:
    """Bodies that no forces balance under a push, with or without tipping; and whether that is clear."""
    before, clear = motion(pile, frame, group, pairs, push), True
    gone = {removed} - {-1}
    while True:
        away = [p for p in pairs if off[p] or gone & set(pile.part[p])]
        rest = [p for p in pairs if p not in away]
        rocked = {int(b) for p in away for b in pile.owner[p]} - gone - {-1}
        left = linked(rocked, pile, rest)
        bear = [p for p in rest if left & set(pile.owner[p])]
        moved = motion(pile, frame, left, bear, push)
        eased = motion(pile, frame, left, bear, EASED * push) if tips else moved
        over = {b: tips and eased[b] < STILL for b in left}
        least = {b: (TIPS if over[b] else LOST) + before[b] for b in left}
        clear &= all(abs(moved[b] - least[b]) > 1e-4 for b in left)
        clear &= not tips or all(abs(eased[b] - STILL) > 0.5 * STILL for b in left)
        fallen = {b for b in left if moved[b] > least[b]}
        if not fallen:
            return gone, clear
        gone |= fallen


def given(pile: Pile, frame: int, bodies: set[int], pairs, push) -> dict[int, float]:
    """How strongly each starts to move, in g, once its contacts give."""
    order = sorted(bodies)
    number = np.full(len(pile.mass) + 1, -1)  # the last is the ground's
    number[order] = np.arange(len(order))
    pairs = [p for p in pairs if pile.owner[p, 0] != pile.owner[p, 1]]
    which = [n for p in pairs for n in range(pile.start[p, frame], pile.start[p, frame + 1])]
    many = [pile.start[p, frame + 1] - pile.start[p, frame] for p in pairs]
    owner = np.repeat(number[pile.owner[pairs]].reshape(-1, 2), many, axis=0)
    there = Bodies(pile.mass[order], pile.centre[frame][order], pile.inertia[frame][order])
    touches = Touches(
        *np.ascontiguousarray(owner.T),
        pile.position[which].reshape(-1, 3),
        pile.normal[which].reshape(-1, 3),
        pile.friction[which],
    )
    moved = unbalanced(there, touches, pile.force[which].reshape(-1, 3), tuple(push))
    return dict(zip(order, moved.tolist(), strict=True))


def linked(bodies: set[int], pile: Pile, pairs) -> set[int]:
    """The bodies and all that pairs of bodies join to them."""
    found = set(bodies)
    for _ in pile.mass:
        for i, j in pile.owner[pairs].tolist() if len(pairs) else []:
            if min(i, j) >= 0 and found & {i, j}:
                found |= {i, j}
    return found


def motion(pile: Pile, frame: int, bodies: set[int], pairs, push) -> dict[int, float]:
    """How strongly each starts to move, in g, by least squares over all edges of the cones."""
    whiten = np.zeros((6 * len(pile.mass),) * 2)
    for b, inertia in enumerate(pile.inertia[frame]):
        at = 6 * b
        whiten[at : at + 3, at : at + 3] = np.eye(3) / np.sqrt(pile.mass[b])
        whiten[at + 3 : at + 6, at + 3 : at + 6] = np.linalg.inv(np.linalg.cholesky(inertia))
    columns = []
    for p in pairs:
        i, j = pile.owner[p]
        if i == j:
            continue
        for n in range(pile.start[p, frame], pile.start[p, frame + 1]):
            normal = pile.normal[n]
            u = np.cross(normal, [1.0, 0, 0] if abs(normal[0]) < 0.9 else [0, 1.0, 0])
            u /= np.linalg.norm(u)
            for angle in np.arange(CONE_SIDES) * 2 * np.pi / CONE_SIDES:
                side = np.cos(angle) * u + np.sin(angle) * np.cross(normal, u)
                force = normal + pile.friction[n] * side
                column = np.zeros(len(whiten))
                for b, sign in ((i, -1.0), (j, 1.0)):
                    if b >= 0:
                        arm = pile.position[n] - pile.centre[frame, b]
                        column[6 * b : 6 * b + 6] = [*(sign * force), *np.cross(arm, sign * force)]
                columns.append(whiten @ column)
    weight = np.zeros((len(pile.mass), 6))
    for b in bodies:
        weight[b, :3] = np.sqrt(pile.mass[b]) * np.array([-push[0], -push[1], 1.0])
    weight = weight.ravel()
    left = weight
    if columns:
        effect = np.array(columns).T
        effect = effect / np.linalg.norm(effect, axis=0)
        left = weight - effect @ shares(effect, weight)
    moved = np.sqrt((left.reshape(-1, 6) ** 2).sum(1) / pile.mass)
    return {b: float(moved[b]) for b in bodies}


def shares(effect: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(M,) non-negative, of columns (N, M) that come nearest to the weight: Lawson & Hanson, ch. 23."""
    gram = effect.T @ effect + COMPLIANCE * np.eye(effect.shape[1])
    wanted, share = effect.T @ weight, np.zeros(effect.shape[1])
    used = np.zeros(len(share), np.bool_)
    while True:
        gain = np.where(used, -np.inf, effect.T @ (weight - effect @ share))
        if gain.max() <= TOLERANCE * np.linalg.norm(weight):
            return share
        used[gain.argmax()] = True
        while True:
            trial = np.zeros(len(share))
            trial[used] = np.linalg.solve(gram[np.ix_(used, used)], wanted[used])
            low = used & (trial <= 0)
            if not low.any():
                break
            share += (share[low] / (share - trial)[low]).min() * (trial - share)
            used &= share > 1e-14
        share = trial
