"""Stretches over which bodies lie on each other as they did."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.geometry.pose import angle, matrix, relative
from safestage_eval.relations.shifts import SHIFTED, TURNED, Layout, stays_for, stretch_starts

BODIES, FRAMES = 3, 60


def walks(rng: np.random.Generator, step: float) -> tuple[np.ndarray, np.ndarray]:
    """(K, T, 3) m and (K, T, 4): bodies that stand, tremble, and move now and then."""
    moves = (rng.random((BODIES, FRAMES, 1)) < 0.2) * step
    place = (rng.normal(size=(BODIES, FRAMES, 3)) * (moves + 1e-6)).cumsum(axis=1)
    turn = (rng.normal(size=(BODIES, FRAMES, 4)) * (20 * moves + 1e-6)).cumsum(axis=1)
    turn += rng.normal(size=(BODIES, 1, 4))
    turn /= np.linalg.norm(turn, axis=2, keepdims=True)
    return place.astype(np.float32), turn.astype(np.float32)


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=60)
def test_stretches_end_where_bodies_and_contact_points_have_moved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    place, turn = walks(rng, 4e-4)
    pair = np.array([[0, 1], [1, 2]])
    many = np.pad(np.full((2, FRAMES), 4), ((0, 0), (1, 0)))
    start = many.cumsum().reshape(many.shape)
    follows = place[pair[:, 0]].astype(float)  # contact points go with the first body, or jump
    point = np.repeat(follows.reshape(-1, 3), 4, axis=0) + np.tile(
        [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]], (2 * FRAMES, 1)
    )
    point += (rng.random((len(point), 1)) < 0.02) * 0.05
    normal = np.tile([0.0, 0.0, 1.0], (len(point), 1))
    layout = Layout(place, turn, place.astype(float), pair, start, point, normal)
    frames = np.flatnonzero(rng.random(FRAMES) < 0.9)
    part = (frames // 25).astype(np.int32)
    found = np.empty(len(frames), np.int64)
    stretch_starts(layout, frames, part, found)
    begin = frames[0]
    for k, t in enumerate(frames):
        new = k == 0 or part[k] != part[k - 1]
        if new or (moved(layout, begin, t) and rearranged(layout, begin, t)):
            begin = t
        assert found[k] == begin


def moved(layout: Layout, s: int, t: int) -> bool:
    """A body leans otherwise, or lies otherwise on another; what trembles has not."""
    p, q = layout.position, layout.orientation
    stays = [
        np.abs(p[b, t] - p[b, s]).max() < SHIFTED / 4
        and np.abs(q[b, t] - q[b, s]).max() < TURNED / 40
        for b in range(BODIES)
    ]
    for i, j in layout.pair:
        if stays[i] and stays[j]:
            continue
        (one, first), (other, second) = (
            relative(p[i, u], q[i, u], p[j, u], q[j, u]) for u in (s, t)
        )
        if np.linalg.norm(other - one) > SHIFTED or angle(first, second) > TURNED:
            return True
        up = [matrix(q[b, t])[2] - matrix(q[b, s])[2] for b in (i, j)]
        if max(np.linalg.norm(v) for v in up) > TURNED:
            return True
    return False


def rearranged(layout: Layout, s: int, t: int) -> bool:
    return any(np.abs(laid_out(layout, p, t) - laid_out(layout, p, s)).max() > 1 for p in range(2))


def laid_out(layout: Layout, p: int, t: int) -> np.ndarray:
    """Mean point from both centres, mean normal, spread, each in units of what matters."""
    rows = slice(layout.start[p, t], layout.start[p, t + 1])
    point = layout.point[rows]
    out = point - point.mean(axis=0)
    spread = out.T @ out / len(out)
    size = max(np.sqrt(np.trace(spread)), SHIFTED)
    centres = [(point.mean(axis=0) - layout.centre[b, t]) / SHIFTED for b in layout.pair[p]]
    normal = layout.normal[rows].mean(axis=0) / TURNED
    return np.concatenate([*centres, normal, spread.ravel() / (SHIFTED * size)])


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=60)
def test_a_rest_lasts_until_something_moves_joins_or_is_touched(seed: int) -> None:
    rng = np.random.default_rng(seed)
    place, turn = walks(rng, 2e-3)
    joined = np.ones((BODIES, FRAMES), np.bool_)
    joined[2] = rng.random(FRAMES) < rng.choice([0.0, 0.3, 1.0])
    loose = rng.random(FRAMES) < 0.97
    frame = int(rng.integers(0, FRAMES))
    earliest = int(rng.integers(0, frame + 1))
    loose[frame] = True
    found = stays_for(place, turn, joined, loose, frame, earliest, 1e-3, 1e-2)

    def there(b: int, t: int) -> bool:
        shift, arc = (np.abs(v[b, t] - v[b, frame]).max() for v in (place, turn))
        return bool(shift < np.float32(1e-3) and arc < np.float32(1e-2))

    own = np.flatnonzero(joined[:, frame])
    for way, limit, end in ((-1, earliest, found[0]), (1, FRAMES - 1, found[1] - 1)):
        come: set[int] = set()
        t = frame
        while t != limit:
            new = {b for b in range(BODIES) if joined[b, t + way]} - come - {*own}
            if not (loose[t + way] and all(there(b, t + way) for b in (*own, *new))):
                break
            come |= new
            t += way
        assert t == end
