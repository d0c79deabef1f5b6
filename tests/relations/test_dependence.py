"""Dependence by statics on scenes whose answer is known from mechanics."""

import itertools

import numpy as np
import pytest
from scenes import G, Scene, moves
from told import doubt_of, holds, why_unknown

from safestage_eval.episode import Geom
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.relations.statics import LOST


def depends(scene: Scene, body: str, on: str) -> bool:
    found = holds(Relations(Signals(scene.episode())), "depends_on", (body, on))
    assert found is not None
    assert found.all() or not found.any()
    return bool(found[0])


def said(scene: Scene, body: str, on: str) -> bool | None:
    """None: open throughout."""
    relations = Relations(Signals(scene.episode()))
    doubt = doubt_of(relations, "depends_on", (body, on))
    if doubt is not None and doubt[0].all():
        return None
    assert doubt is None
    return depends(scene, body, on)


def stack() -> Scene:
    """a on the table, b on a, c on b; 1 kg each."""
    scene = Scene(3).fixed("table")
    for i, name in enumerate("abc"):
        scene.box(name, 0.05, (0, 0, 0.05 + 0.1 * i))
    scene.rests("a", "table", 0.05, (0, 0, 0), 3 * G)
    scene.rests("b", "a", 0.05, (0, 0, 0.1), 2 * G)
    return scene.rests("c", "b", 0.05, (0, 0, 0.2), G)


@pytest.mark.parametrize(
    ("body", "on", "truth"),
    [("b", "a", True), ("c", "b", True), ("c", "a", True), ("a", "b", False), ("b", "c", False)],
)
def test_stack_of_three(body: str, on: str, truth: bool) -> None:
    assert depends(stack(), body, on) is truth


def piers(xs: tuple[float, ...]) -> Scene:
    """A 1 kg board, 40 cm long, its COM at x = 0, on piers at the given x."""
    scene = Scene(2).fixed("table").box("board", (0.2, 0.05, 0.01), (0, 0, 0.11))
    for i, x in enumerate(xs):
        scene.box(f"p{i}", 0.03, (x, 0, 0.05))
        scene.rests(f"p{i}", "table", 0.03, (x, 0, 0), G * (1 + 1 / len(xs)))
        scene.rests("board", f"p{i}", 0.03, (x, 0, 0.1), G / len(xs))
    return scene


def test_bridge_depends_on_both_of_two_piers() -> None:
    scene = piers((-0.12, 0.12))
    assert depends(scene, "board", "p0")
    assert depends(scene, "board", "p1")


def test_a_load_tips_what_it_stands_on() -> None:
    """The board alone would stay on p0; with the load at its far end it needs p1."""
    scene = Scene(2).fixed("table").box("p0", 0.05, (0, 0, 0.05)).box("p1", 0.03, (0.3, 0, 0.05))
    scene.box("board", (0.35, 0.05, 0.01), (0.0, 0, 0.11)).box("load", 0.03, (0.3, 0, 0.15), mass=2)
    scene.rests("p0", "table", 0.05, (0, 0, 0), 2 * G).rests(
        "p1", "table", 0.03, (0.3, 0, 0), 3 * G
    )
    scene.rests("board", "p0", 0.05, (0, 0, 0.1), G).rests(
        "board", "p1", 0.03, (0.3, 0, 0.1), 2 * G
    )
    scene.rests("load", "board", 0.03, (0.3, 0, 0.12), 2 * G)
    assert depends(scene, "board", "p1")
    assert depends(scene, "load", "p1")
    assert not depends(scene, "board", "load")


def test_ball_in_a_groove_depends_on_both_sides() -> None:
    scene = Scene(2).fixed("table")
    for name, x in (("left", -0.045), ("right", 0.045)):
        scene.box(name, 0.035, (x, 0, 0.035)).rests(name, "table", 0.03, (x, 0, 0), 1.5 * G)
    scene.box("ball", 0.035, (0, 0, 0.1))
    slope = np.array([0.6, 0.0, 0.8])
    scene.contact("left", "ball", (-0.02, 0, 0.07), slope * G / 1.6, normal=slope)
    scene.contact(
        "right", "ball", (0.02, 0, 0.07), slope * (-1, 1, 1) * G / 1.6, normal=slope * (-1, 1, 1)
    )
    assert depends(scene, "ball", "left")
    assert depends(scene, "ball", "right")


def test_a_held_body_no_longer_depends() -> None:
    scene = stack()
    for side, x in (("left", 1), ("right", -1)):
        scene.box(side, 0.01, (-0.06 * x, 0, 0.25), kind="gripper", finger=side)
        scene.contact(side, "c", (-0.05 * x, 0, 0.25), (30 * x, 0, 0), normal=(x, 0, 0))
    assert not depends(scene, "c", "a")
    assert depends(scene, "b", "a")


@pytest.mark.parametrize("friction", [0.2, 0.5, 1.0])
def test_sliding_on_a_slope_starts_at_the_friction_angle(friction: float) -> None:
    """A block stands on a slope iff tan(slope) <= friction; up to the cone's eight sides."""
    limit = np.arctan(friction)
    corners = 0.05 * np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]], float)
    for slope, stands in ((limit * 0.9, True), (limit * 1.25, False)):
        c, s = np.cos(slope), np.sin(slope)
        turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        normal = np.broadcast_to(turn[:, 2], (4, 3))
        # tall enough not to matter: the lever is short
        points = corners * [1, 1, 0.01] @ turn.T
        assert (moves(normal, np.full(4, friction), points) <= 0.02) is stands


@pytest.mark.parametrize(
    ("overhang", "stands"),
    [(0.04, True), (0.049, True), (0.0505, True), (0.053, False), (0.056, False)],
)
def test_overhang_stands_while_the_com_is_over_the_support(overhang: float, stands: bool) -> None:
    """A block of half width 5 cm whose support ends ``overhang`` before its far side."""
    edge = 0.05 - overhang
    points = np.array([[-0.05, -0.05, 0], [edge, -0.05, 0], [edge, 0.05, 0], [-0.05, 0.05, 0]])
    up = np.broadcast_to([0.0, 0.0, 1.0], (4, 3))
    assert (moves(up, np.ones(4), points) <= LOST) is stands


@pytest.mark.parametrize("order", list(itertools.permutations(["s", "a", "board", "box"]))[::3])
def test_the_order_of_bodies_does_not_matter(order: tuple[str, ...]) -> None:
    """Two piers, a board on both, a box in its middle: no pier depends on the other."""
    places = {
        "s": (-0.12, 0, 0.05),
        "a": (0.12, 0, 0.05),
        "board": (0, 0, 0.11),
        "box": (0, 0, 0.15),
    }
    scene = Scene(2).fixed("table")
    for name in order:
        half = (0.2, 0.05, 0.01) if name == "board" else 0.03
        scene.box(name, half, places[name])
    for name, x in (("s", -0.12), ("a", 0.12)):
        scene.rests(name, "table", 0.03, (x, 0, 0), 2 * G)
        scene.rests("board", name, 0.03, (x, 0, 0.1), G)
    scene.rests("box", "board", 0.03, (0, 0, 0.12), G)
    assert not depends(scene, "a", "s")
    assert depends(scene, "board", "s")
    assert depends(scene, "box", "s")


def test_without_masses_nothing_is_claimed() -> None:
    scene = stack()
    scene.bodies = [
        b.model_copy(update={"mass": None}) if b.name == "b" else b for b in scene.bodies
    ]
    found = Relations(Signals(scene.episode()))
    assert "mass of b" in why_unknown(found, "depends_on", ("b", "a"))


@pytest.mark.parametrize("kind", ["fixture", "robot"])
def test_a_load_that_leans_on_an_immobile_base_is_a_load(kind: str) -> None:
    """The robot's base is a fixture: what touches it is not in the robot's hands."""
    slippery = Geom(kind="box", size=(0.2, 0.2, 0.2), friction=(0, 0, 0))
    scene = Scene(2).fixed("table").fixed("base", (0.36, 0, 0.1), kind=kind, geoms=(slippery,))
    scene.box("board", (0.2, 0.05, 0.01), (0, 0, 0.11))
    smooth = Geom(kind="box", size=(0.04,) * 3, friction=(0, 0, 0))
    scene.body("load", smooth, (0.12, 0, 0.16), mass=3)
    for name, x in (("left", -0.02), ("right", 0.15)):
        scene.box(name, 0.03, (x, 0, 0.05)).rests(name, "table", 0.03, (x, 0, 0), 3 * G)
        scene.rests("board", name, 0.02, (x, 0, 0.1), 2 * G)
    scene.rests("load", "board", 0.04, (0.12, 0, 0.12), 3 * G)
    scene.contact("base", "load", (0.16, 0, 0.16), (-0.5, 0, 0), normal=(-1, 0, 0))
    assert depends(scene, "board", "right")  # the load would tip it over the left one


def test_dependence_follows_a_tray_that_is_tilted() -> None:
    """A block on a tray, and a rough stop that it needs where the tray is too steep for it."""
    frames, friction = 41, (0.3, 0, 0)
    slab = Geom(kind="box", size=(0.2, 0.2, 0.01), friction=friction)
    cube = Geom(kind="box", size=(0.03, 0.03, 0.01), friction=friction)
    angle = np.linspace(0, 0.5, frames)  # slides from atan(0.3) = 0.291 rad on
    turn = np.stack([np.cos(angle / 2), 0 * angle, np.sin(angle / 2), 0 * angle], 1)
    up = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], 1)
    along = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], 1)
    scene = Scene(frames).fixed("wall").body("tray", slab, (0, 0, 1), turn)
    scene.body("block", cube, up * 0.02 + (0, 0, 1), turn)
    rough = cube.model_copy(update={"friction": (2.0, 0, 0)})
    scene.body("stop", rough, up * 0.02 + along * 0.06 + (0, 0, 1), turn)
    across = np.array([0, 0.03, 0])
    for frame in range(frames):
        here, one = [0, 0, 1] + up[frame] * 0.01, slice(frame, frame + 1)
        scene.rests("tray", "wall", 0.2, (0, 0, 0.99), 3 * G, frames=one)
        for name, shift in (("block", 0.0), ("stop", 0.06)):
            corners = [
                here + (shift + a) * along[frame] + b * across
                for a, b in ((-0.03, -1), (0.03, -1), (0.03, 1), (-0.03, 1))
            ]
            scene.contact("tray", name, corners, (0, 0, G), normal=up[frame], frames=one)
        side = here + 0.03 * along[frame]
        scene.contact(
            "stop", "block", [side - across, side + across], -0.1 * along[frame],
            normal=-along[frame], frames=one,
        )  # fmt: skip
    found = holds(Relations(Signals(scene.episode())), "depends_on", ("block", "stop"))
    assert found is not None
    first = int(np.argmax(found))
    assert found[first:].all()
    assert angle[first] == pytest.approx(np.arctan(0.3 * 1.02), abs=0.03)  # 2 % of slack


@pytest.mark.parametrize(
    ("force", "gap", "falls"),
    [(0.0, 0.0, None), (0.0, 9e-4, None), (0.0, 1.1e-3, True), (G / 2, 0.0, False)],
)
def test_what_is_near_and_carries_nothing_leaves_it_open(
    force: float, gap: float, falls: bool | None
) -> None:
    """A post beneath a board that hangs over one pier: it may catch it, unless it is too far."""
    scene = Scene(2).fixed("table").box("pier", 0.05, (0, 0, 0.05))
    scene.fixed("post", (0.3, 0, 0.1 - gap)).box("board", (0.2, 0.05, 0.01), (0.12, 0, 0.11))
    scene.box("hook", 0.03, (-0.05, 0, 0.15))
    scene.rests("pier", "table", 0.05, (0, 0, 0), 2 * G)
    scene.rests("board", "pier", 0.05, (0, 0, 0.1), 2 * G)
    scene.rests("board", "post", 0.01, (0.3, 0, 0.1), force)
    scene.rests("hook", "board", 0.03, (-0.05, 0, 0.12), G)
    assert said(scene, "board", "hook") is falls


def test_a_cup_on_a_tray_in_a_drawer_depends_on_the_drawer() -> None:
    """Pulled out with both, forces recorded; the cabinet beside it bears nothing."""
    frames = 60
    x = np.linspace(0, 0.2, frames)
    scene = Scene(frames).fixed("cabinet")
    for name, half, z, fields in (
        ("drawer", (0.2, 0.2, 0.02), 0.5, {"kind": "fixture", "parent": "cabinet"}),
        ("tray", (0.1, 0.1, 0.01), 0.53, {}),
        ("cup", (0.03, 0.03, 0.05), 0.59, {}),
    ):
        scene.box(name, half, np.stack([x, 0 * x, 0 * x + z], 1), **fields)
    for frame in range(frames):
        one = slice(frame, frame + 1)
        scene.rests("tray", "drawer", 0.1, (x[frame], 0, 0.52), 2 * G, frames=one)
        scene.rests("cup", "tray", 0.03, (x[frame], 0, 0.54), G, frames=one)
    found = Relations(Signals(scene.episode()))
    for body, on in (("cup", "drawer"), ("cup", "tray"), ("tray", "drawer"), ("cup", "cabinet")):
        assert holds(found, "depends_on", (body, on)).all(), (body, on)
        assert doubt_of(found, "depends_on", (body, on)) is None
    for body, on in (("tray", "cup"), ("drawer", "cup"), ("drawer", "cabinet"), ("cup", "cup")):
        assert not holds(found, "depends_on", (body, on)).any(), (body, on)
