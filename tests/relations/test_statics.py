"""Balance by friction cones against what mechanics says of ladders, slopes and overhangs."""

import numpy as np
import pytest
from balances import motion
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import G, Scene, moves
from scipy.optimize import linprog

from safestage_eval.episode import Geom
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.cones import CONE_SIDES
from safestage_eval.relations.relations import Relations
from safestage_eval.relations.statics import ARM, LOST, Bodies, Touches


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=60)
def test_nothing_moves_where_a_linear_program_finds_forces(seed: int) -> None:
    """Draw up to three bodies that touch at random; forces within the same cones."""
    rng = np.random.default_rng(seed)
    bodies, points = int(rng.integers(1, 4)), int(rng.integers(1, 13))
    normal = rng.normal(size=(points, 3)) + np.array([0, 0, rng.uniform(0, 3)])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    second = rng.integers(0, bodies, points)
    first = np.where(rng.random(points) < 0.6, -1, (second + 1) % bodies)
    first = np.where(first == second, -1, first)
    touches = Touches(
        first, second, rng.uniform(-0.1, 0.1, (points, 3)), normal, rng.uniform(0.1, 1.2, points)
    )
    centre = rng.uniform(-0.02, 0.02, (bodies, 3)) + np.array([0, 0, 0.03])
    mass = rng.uniform(0.1, 2, bodies)
    group = Bodies(mass, centre, mass[:, None, None] * ARM**2 * np.eye(3))
    found = motion(group, touches)
    shares, weight = edges(group, touches), np.zeros((bodies, 6))
    weight[:, 2] = mass
    lacking = least_lack(shares, weight.ravel())
    if lacking > 0.02:
        assert found.max() > 1e-3
    if lacking < 1e-9:
        assert found.max() < 1e-3


def edges(group: Bodies, touches: Touches) -> np.ndarray:
    """(6 B, E) force and torque / ARM of each edge of each friction pyramid, on all bodies."""
    out = []
    for i, j, at, n, mu in zip(*touches, strict=True):
        helper = [0.0, 1.0, 0.0] if abs(n[0]) >= 0.9 else [1.0, 0.0, 0.0]
        u = np.cross(n, helper)
        u /= np.linalg.norm(u)
        for angle in np.arange(CONE_SIDES) * 2 * np.pi / CONE_SIDES:
            force = n + mu * (np.cos(angle) * u + np.sin(angle) * np.cross(n, u))
            column = np.zeros((len(group.mass), 6))
            for body, sign in ((i, -1), (j, 1)):
                if body >= 0:
                    torque = np.cross(at - group.centre[body], sign * force) / ARM
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
        found = Relations(Signals(leaning(angle, friction).episode())).get(
            "depends_on", ("board", "stop")
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
        assert facts.get("depends_on", ("board", "weight")).all() == needed
        assert facts.get("depends_on", ("weight", "pier")).all()
