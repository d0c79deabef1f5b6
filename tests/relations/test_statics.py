"""Balance by friction cones against what mechanics says of ladders, slopes, overhangs and wedges."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled import tries
from scenes import G, Scene, alone, motion, moves
from scipy.optimize import linprog
from told import holds

from safestage_eval.episode import Geom
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.relations.statics import ARM, CONE_SIDES, LOST, PUSHES, Pile, fallen


def drawn(rng: np.random.Generator, most: int) -> Pile:
    """Bodies that touch each other and the ground at random."""
    bodies, points = int(rng.integers(1, most)), int(rng.integers(1, 13))
    normal = rng.normal(size=(points, 3)) + np.array([0, 0, rng.uniform(0, 3)])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    second = rng.integers(0, bodies, points)
    first = np.where(rng.random(points) < 0.6, -1, (second + 1) % bodies)
    first = np.where(first == second, -1, first)
    mass = rng.uniform(0.1, 2, bodies)
    return Pile(
        mass, rng.uniform(-0.02, 0.02, (bodies, 3)) + np.array([0, 0, 0.03]),
        mass[:, None, None] * ARM**2 * np.eye(3), first, second,
        rng.uniform(-0.1, 0.1, (points, 3)), normal, rng.uniform(0.1, 1.2, points),
    )  # fmt: skip


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=tries(20, 60))
def test_nothing_moves_where_a_linear_program_finds_forces(seed: int) -> None:
    pile = drawn(np.random.default_rng(seed), 4)
    weight = np.zeros((len(pile.mass), 6))
    weight[:, 2] = pile.mass
    lacking = least_lack(edges(pile), weight.ravel())
    if lacking > 0.02:
        assert motion(pile).max() > 1e-3
    if lacking < 1e-9:
        assert motion(pile).max() < 1e-3


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=tries(20, 60))
def test_a_collapse_is_found_as_step_by_step(seed: int) -> None:
    """By bounded least squares over all edges at once, for each set of bodies."""
    rng = np.random.default_rng(seed)
    pile = drawn(rng, 6)
    gone, off = rng.random(len(pile.mass)) < 0.2, rng.random(len(pile.first)) < 0.2
    out, clear = gone.copy(), True
    for push in PUSHES:
        away, before = gone, densely(pile, ~np.zeros_like(gone), ~np.zeros_like(off), push)
        while True:
            there = np.append(~away, True)
            now = densely(pile, ~away, ~off & there[pile.first] & there[pile.second], push)
            clear &= bool((np.abs(now - before - LOST) > 1e-4).all())
            if not (now > before + LOST).any():
                break
            away = away | (now > before + LOST)
        out |= away
    if clear:  # nothing moves by nearly LOST
        assert fallen(pile, gone, off).tolist() == out.tolist()


def densely(pile: Pile, left: np.ndarray, kept: np.ndarray, push: np.ndarray) -> np.ndarray:
    """(B,) how strongly each body moves, in g, by all edges at once; 0 of those that are not left."""
    heavy = np.repeat(np.sqrt(pile.mass), 6)
    weight = np.outer(pile.mass, [-push[0], -push[1], 1, 0, 0, 0]).ravel() / heavy
    rows = np.repeat(left, 6)
    columns = (edges(pile) / heavy[:, None])[rows][:, np.repeat(kept, CONE_SIDES)]
    rest = np.zeros(len(rows))
    rest[rows] = weight[rows]
    if columns.size:
        rest[rows] -= columns @ nearest(columns, weight[rows])
    return np.asarray(np.linalg.norm((rest / heavy).reshape(-1, 6), axis=1))


def nearest(effect: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(M,) non-negative, of columns (N, M) that come nearest to the weight: Lawson & Hanson, ch. 23."""
    gram = effect.T @ effect + 1e-9 * np.eye(effect.shape[1])
    wanted, share = effect.T @ weight, np.zeros(effect.shape[1])
    used = np.zeros(len(share), np.bool_)
    while True:
        gain = np.where(used, -np.inf, effect.T @ (weight - effect @ share))
        if gain.max() <= 1e-7 * np.linalg.norm(weight):
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


def edges(pile: Pile) -> np.ndarray:
    """(6 B, E) force and torque / ARM of each edge of each friction pyramid, on all bodies."""
    out = []
    for i, j, at, n, mu in zip(*pile[3:], strict=True):
        helper = [0.0, 1.0, 0.0] if abs(n[0]) >= 0.9 else [1.0, 0.0, 0.0]
        u = np.cross(n, helper)
        u /= np.linalg.norm(u)
        for angle in np.arange(CONE_SIDES) * 2 * np.pi / CONE_SIDES:
            force = n + mu * (np.cos(angle) * u + np.sin(angle) * np.cross(n, u))
            column = np.zeros((len(pile.mass), 6))
            for body, sign in ((i, -1), (j, 1)):
                if body >= 0:
                    torque = np.cross(at - pile.centre[body], sign * force) / ARM
                    column[body] = [*(sign * force), *torque]
            out.append(column.ravel())
    return np.array(out).T


def least_lack(wrench: np.ndarray, weight: np.ndarray) -> float:
    """The largest component of what stays unbalanced, made as small as can be."""
    rows, columns = wrench.shape
    slack = -np.ones((rows, 1))
    solved = linprog(
        np.append(np.zeros(columns), 1.0),
        A_ub=np.block([[wrench, slack], [-wrench, slack]]),
        b_ub=np.concatenate([weight, -weight]),
        bounds=(0, None),
    )
    return float(solved.fun)


@pytest.mark.parametrize("friction", [0.2, 0.4, 0.7])
@pytest.mark.parametrize("spin", [0.0, 0.2, 0.39])
def test_a_ladder_stands_above_its_critical_angle(friction: float, spin: float) -> None:
    """Uniform, equal friction µ at floor and wall: it stands iff tan θ ≥ (1 − µ²) / 2µ."""
    critical = np.arctan2(1 - friction**2, 2 * friction)
    c, s = np.cos(spin), np.sin(spin)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    for angle, stands in ((critical * 1.08, True), (critical * 0.9, False)):
        along = 0.2 * np.array([np.cos(angle), 0, np.sin(angle)])
        sideways = np.array([[0, -0.05, 0], [0, 0.05, 0]])
        point = np.concatenate([-along + sideways, along + sideways]) @ turn.T
        normal = np.array([[0, 0, 1], [0, 0, 1], [-1, 0, 0], [-1, 0, 0]], float) @ turn.T
        assert (moves(normal, np.full(4, friction), point) <= LOST) is stands


def leaning(angle: float, friction: float) -> Scene:
    """A 40 cm board at an angle against a wall, its foot on a table and against a stop."""
    rough = (friction, 0.0, 0.0)
    slab = Geom(kind="box", size=(0.5, 0.5, 0.02), position=(0, 0, -0.02), friction=rough)
    block = Geom(kind="box", size=(0.02, 0.1, 0.02), friction=rough)
    plank = Geom(kind="box", size=(0.2, 0.05, 0.001), friction=rough)
    half = 0.2 * np.array([np.cos(angle), 0, np.sin(angle)])
    scene = (
        Scene(2).fixed("table", geoms=(slab,)).fixed("wall", (2 * half[0], 0, 0), geoms=(block,))
    )
    scene.body("board", plank, half, (np.cos(angle / 2), 0, -np.sin(angle / 2), 0))
    scene.body("stop", block, (-0.02, 0, 0.02)).rests("stop", "table", 0.02, (-0.02, 0, 0), G)
    ends = np.array([[0, -0.05, 0], [0, 0.05, 0]])
    scene.contact("table", "board", ends, (0, 0, G))
    scene.contact("wall", "board", ends + 2 * half, (-1, 0, 0), normal=(-1, 0, 0))
    return scene.contact("stop", "board", ends, (1, 0, 0), normal=(1, 0, 0))


@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_a_leaning_board_needs_a_stop_where_friction_does_not_do(friction: float) -> None:
    critical = np.arctan2(1 - friction**2, 2 * friction)
    for angle, needed in ((critical * 1.08, False), (critical * 0.9, True)):
        found = holds(
            Relations(Signals(leaning(angle, friction).episode())), "depends_on", ("board", "stop")
        )
        assert found is not None
        assert found.all() == needed
        assert found.any() == needed


def test_a_counterweight_that_is_needed_and_one_that_is_not() -> None:
    """A board reaches 5 cm over a pier with its COM, or not; a weight on its other end holds it."""
    for shift, needed in ((0.10, True), (0.02, False)):
        scene = Scene(2).fixed("table").box("pier", 0.05, (0, 0, 0.05), mass=5.0)
        scene.box("board", (0.2, 0.05, 0.01), (shift, 0, 0.11))
        scene.box("weight", 0.02, (shift - 0.18, 0, 0.14), mass=2.0)
        scene.rests("pier", "table", 0.05, (0, 0, 0), 8 * G)
        scene.rests("board", "pier", 0.05, (0, 0, 0.1), 3 * G)
        scene.rests("weight", "board", 0.02, (shift - 0.18, 0, 0.12), 2 * G)
        facts = Relations(Signals(scene.episode()))
        assert holds(facts, "depends_on", ("board", "weight")).all() == needed
        assert holds(facts, "depends_on", ("weight", "pier")).all()


FEET = 0.05 * np.array([[x, y, -1.0] for x in (-1, 1) for y in (-1, 1)])


def standing(points: np.ndarray, friction: float) -> Pile:
    return alone(np.tile([0.0, 0, 1], (len(points), 1)), np.full(len(points), friction), points)


def test_what_nothing_touches_falls_as_fast_as_anything() -> None:
    assert motion(standing(FEET[:0], 0.5)) == pytest.approx([1.0])


def test_a_side_that_nothing_bears_tips() -> None:
    assert motion(standing(FEET[:2], 0.9))[0] > 0.1
    assert motion(standing(FEET, 0.9))[0] < 1e-6


@pytest.mark.parametrize("friction", [0.5, 0.15])
def test_a_push_slides_what_friction_does_not_hold(friction: float) -> None:
    low = FEET * [1, 1, 0.01]
    moved = motion(standing(low, friction), (0.3, 0.0))[0]
    assert moved == pytest.approx(max(0.3 - friction, 0.0), abs=0.02)


@pytest.mark.parametrize(("friction", "stands"), [(0.6, True), (0.0, False)])
def test_walls_hold_a_wedged_block_by_friction(friction: float, stands: bool) -> None:
    sides = 0.05 * np.array([[s, y, z] for s in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    normal = np.sign(sides) * [-1.0, 0, 0]
    assert (moves(normal, np.full(8, friction), sides) < LOST) is stands


def test_the_unit_of_mass_makes_no_difference() -> None:
    pile = standing(FEET[:3] + np.array([0.004, 0.0, 0.0]), 0.3)
    heavy = pile._replace(mass=1000 * pile.mass, inertia=1000 * pile.inertia)
    assert motion(heavy, (0.02, 0)) == pytest.approx(motion(pile, (0.02, 0)), abs=1e-6)


@given(st.integers(0, 2**32 - 1), st.floats(-10, 10), st.floats(-10, 10))
@settings(deadline=None, max_examples=30)
def test_where_a_pile_stands_makes_no_difference(seed: int, x: float, y: float) -> None:
    """Nor by how many quarters it is turned."""
    pile = drawn(np.random.default_rng(seed), 4)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    there = pile._replace(
        centre=pile.centre @ quarter.T + [x, y, 0],
        position=pile.position @ quarter.T + [x, y, 0],
        normal=pile.normal @ quarter.T,
    )
    assert motion(there) == pytest.approx(motion(pile), abs=0.01)
