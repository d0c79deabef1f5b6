"""How firmly bodies stand: overhangs, stacks, bridges and balls whose answer mechanics gives."""

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scenes import G, Scene

from safestage_eval.episode import Geom
from safestage_eval.evidence.intervals import Interval
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations


def measured(scene: Scene, name: str, *bodies: str, **header: object) -> Interval:
    return Relations(Signals(scene.episode(**header))).signal(name, bodies)


def value(scene: Scene, name: str, *bodies: str) -> float:
    found = measured(scene, name, *bodies)
    assert found.known.all()
    return float(found.value[0])


def corners(low: tuple[float, float], high: tuple[float, float], z: float) -> np.ndarray:
    (x0, y0), (x1, y1) = low, high
    return np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])


def overhanging(width: float, by: float, half_height: float = 0.05) -> Scene:
    """A block on a table that ends at x = 0; it sticks out by so much."""
    scene = Scene(2).fixed("table", (-0.5, 0, 0))
    scene.box("a", (width / 2, 0.2, half_height), (by - width / 2, 0, half_height))
    return scene.contact("table", "a", corners((by - width, -0.2), (0, 0.2), 0), (0, 0, G))


@given(st.floats(0.02, 0.2), st.floats(0.0, 0.95))
def test_a_block_that_overhangs(width: float, part: float) -> None:
    """Half its width less what hangs over, whatever side is nearer; never the long way."""
    by = part * width
    found = value(overhanging(width, by), "support_margin", "a")
    expected = min(width / 2 - by, width / 2, 0.2)
    assert found == pytest.approx(expected, abs=1e-6)


def test_what_rests_on_it_counts_and_what_that_carries() -> None:
    """1 kg in the middle, 2 kg and 1 kg 4 cm to the side, one on the other: COM at 3 cm."""
    scene = Scene(2).fixed("table").box("a", 0.05, (0, 0, 0.05))
    scene.box("b", 0.01, (0.04, 0, 0.11), mass=2.0).box("c", 0.01, (0.04, 0, 0.13))
    scene.rests("a", "table", 0.05, (0, 0, 0), 4 * G).rests("b", "a", 0.01, (0.04, 0, 0.1), 3 * G)
    scene.rests("c", "b", 0.01, (0.04, 0, 0.12), G)
    assert value(scene, "support_margin", "a") == pytest.approx(0.02, abs=1e-6)
    height = (0.05 + 2 * 0.11 + 0.13) / 4
    expected = np.arctan2(0.02, height)
    assert value(scene, "tipping_angle", "a") == pytest.approx(expected, abs=1e-6)


def test_a_pier_carries_its_share_of_a_board_where_it_lies_on_it() -> None:
    """The board's own centre is far off, yet neither pier is about to tip."""
    scene = Scene(2).fixed("table").box("board", (0.2, 0.05, 0.01), (0, 0, 0.11), mass=2.0)
    for name, x in (("p", -0.12), ("q", 0.12)):
        scene.box(name, 0.05, (x, 0, 0.05)).rests(name, "table", 0.05, (x, 0, 0), 2 * G)
        scene.rests("board", name, 0.02, (x * 0.75, 0, 0.1), G)
    assert value(scene, "support_margin", "p") == pytest.approx(0.05 - 0.03 / 2, abs=1e-6)
    assert value(scene, "support_margin", "board") == pytest.approx(0.02, abs=1e-6)
    assert value(scene, "load_share", "board", "p") == pytest.approx(0.5)
    assert value(scene, "load_share", "p", "board") == 0


def test_a_wall_beside_it_is_not_stood_on() -> None:
    """Its COM is 2 cm from the side that the wall is on; a third pier there would make it more."""
    scene = Scene(2).fixed("bin").box("a", 0.05, (0, 0, 0.05), com=(0.03, 0, 0))
    scene.rests("a", "bin", 0.05, (0, 0, 0), G)
    scene.contact("bin", "a", [(0.2, -0.05, 0.1), (0.2, 0.05, 0.1)], (-0.5, 0, 0.01),
                  normal=(-1, 0, 0))  # fmt: skip
    assert value(scene, "support_margin", "a") == pytest.approx(0.02, abs=1e-6)


@pytest.mark.parametrize("points", [[(0, 0)], [(-0.03, 0), (0.03, 0)],
                                    [(-0.03, 0), (0, 1e-5), (0.03, 0)]])  # fmt: skip
def test_a_ball_and_a_rod_have_no_support_polygon(points: list[tuple[float, float]]) -> None:
    scene = Scene(2).fixed("table").body("ball", Geom(kind="sphere", size=(0.035,)), (0, 0, 0.035))
    scene.contact("table", "ball", [(*point, 0.0) for point in points], (0, 0, G))
    for name, most in (("support_margin", 0.035), ("tipping_angle", np.inf)):
        found = measured(scene, name, "ball")
        assert np.isneginf(found.lower).all()
        assert found.upper == pytest.approx(most, abs=2e-3)
        assert "three support contacts" in found.notes[0]


def test_turning_the_scene_about_the_vertical_changes_no_margin() -> None:
    straight = value(overhanging(0.1, 0.03), "support_margin", "a")
    for angle in (0.3, 1.1, 2.9):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        scene = Scene(2).fixed("table", (0, 0, 0))
        scene.box("a", (0.05, 0.2, 0.05), turn @ (0.03 - 0.05, 0, 0.05))
        points = corners((0.03 - 0.1, -0.2), (0, 0.2), 0) @ turn.T
        scene.contact("table", "a", points, (0, 0, G))
        assert value(scene, "support_margin", "a") == pytest.approx(straight, abs=1e-6)


def on_two_edges(lost: slice, path: np.ndarray | float = 0.0) -> Scene:
    """A board of 6 cm across that lies with four corners on a table, but for some of 60 frames."""
    place = np.tile([0.0, 0, 0.01], (60, 1))
    place[:, 0] += path
    scene = Scene(60).fixed("table").box("a", (0.03, 0.2, 0.01), place)
    four = corners((-0.03, -0.2), (0.03, 0.2), 0)
    for frame in range(60):
        missing = frame in range(*lost.indices(60))
        points = (four[:2] if missing else four) + [place[frame, 0], 0, 0]
        scene.contact("table", "a", points, (0, 0, G), frames=slice(frame, frame + 1))
    return scene


def test_contacts_that_are_missing_for_a_moment_leave_what_rests_where_it_stood() -> None:
    """0.1 s at most, and only as long as it does not move."""
    found = measured(on_two_edges(slice(30, 36)), "support_margin", "a")
    assert found.known.all() and found.value == pytest.approx(0.03, abs=1e-6)
    longer = measured(on_two_edges(slice(30, 50)), "support_margin", "a")
    assert np.isneginf(longer.lower[42:50]).all()
    assert np.delete(longer.lower, slice(42, 50)) == pytest.approx(0.03, abs=1e-6)
    assert longer.upper == pytest.approx(0.03, abs=2e-3)
    slides = np.where(np.arange(60) < 30, 0.0, 0.002)
    moved = measured(on_two_edges(slice(30, 36), slides), "support_margin", "a")
    assert np.isneginf(moved.lower[30:36]).all()


def flickering(shown: np.ndarray, path: np.ndarray | float = 0.0) -> Scene:
    """A block of 6 cm on a table: which of its four corners the simulator finds at each frame (T, 4)."""
    frames = len(shown)
    place = np.tile([0.0, 0, 0.03], (frames, 1))
    place[:, 0] += path
    scene = Scene(frames).fixed("table").box("a", 0.03, place)
    four = corners((-0.03, -0.03), (0.03, 0.03), 0)
    for frame in range(frames):
        points = four[shown[frame]] + [place[frame, 0], 0, 0]
        if len(points):
            scene.contact("table", "a", points, (0, 0, G), frames=slice(frame, frame + 1))
    return scene


@given(st.integers(0, 2**32 - 1))
def test_fewer_contacts_never_make_it_stand_more_firmly(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shown = rng.random((40, 4)) < 0.6
    fewer = shown & (rng.random((40, 4)) < 0.8)
    path = np.cumsum(rng.normal(0, 2e-4, 40))
    more = measured(flickering(shown, path), "support_margin", "a")
    less = measured(flickering(fewer, path), "support_margin", "a")
    assert (less.lower <= more.lower + 1e-6).all()


@given(st.integers(0, 2**32 - 1))
@example(526740)
def test_more_contacts_give_a_margin_within_the_bounds_of_fewer(seed: int) -> None:
    """Wherever two bodies of several boxes touch, seen from above within both outlines."""
    rng = np.random.default_rng(seed)
    size, place = rng.uniform(0.02, 0.1, 2), rng.uniform(-0.1, 0.1, 2)
    angle = rng.uniform(0, np.pi)
    turned = (np.cos(angle / 2), 0, 0, np.sin(angle / 2))
    points = rng.uniform(-1, 1, (40, 2)) * size
    c, s = np.cos(angle), np.sin(angle)
    points = points @ np.array([[c, s], [-s, c]]) + place
    parts = [(-0.06, 0.02), (0.05, 0.06)]  # middle and half length along x of what bears it
    on = np.any([(np.abs(points[:, 0] - x) <= half) for x, half in parts], axis=0)
    points = points[on & (np.abs(points[:, 1]) <= 0.1)]
    assume(len(points) >= 3)
    geoms = tuple(
        Geom(kind="box", size=(half, 0.1, 0.02), position=(x, 0, -0.02)) for x, half in parts
    )
    found = []
    for many in (len(points), 2):
        scene = Scene(2).fixed("piers", geoms=geoms)
        scene.body("a", Geom(kind="box", size=(*size, 0.05)), (*place, 0.05), turned)
        at = np.column_stack([points[:many], np.zeros(many)])
        found.append(measured(scene.contact("piers", "a", at, (0, 0, G)), "support_margin", "a"))
    exact, few = found
    assert (few.lower <= exact.lower).all() and (exact.upper <= few.upper).all()
    assert np.isfinite(few.upper).all()
