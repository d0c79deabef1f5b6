"""How firmly bodies stand: overhangs, stacks, bridges and balls whose answer mechanics gives."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scenes import G, Scene

from safestage_eval.episode import Geom
from safestage_eval.evidence.measure import Signals
from safestage_eval.evidence.series import Series
from safestage_eval.geometry.shared_outline import OFF
from safestage_eval.relations import firmness
from safestage_eval.relations.relations import Relations


def measured(scene: Scene, name: str, *bodies: str, **header: object) -> Series:
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


def test_tipping_angle_of_a_block() -> None:
    found = value(overhanging(0.1, 0.02, half_height=0.08), "tipping_angle", "a")
    assert found == pytest.approx(np.arctan2(0.03, 0.08), abs=1e-6)


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


def test_a_body_that_the_hand_holds_rests_on_nothing() -> None:
    """Its weight counts as far as it presses down: here 1 N at 4 cm."""
    scene = Scene(2).fixed("table").box("a", 0.05, (0, 0, 0.05)).box("b", 0.01, (0.04, 0, 0.11))
    scene.rests("a", "table", 0.05, (0, 0, 0), G + 1).rests("b", "a", 0.01, (0.04, 0, 0.1), 1.0)
    for side, sign in (("left", 1), ("right", -1)):
        scene.box(side, 0.01, (0.04 - 0.02 * sign, 0, 0.11), kind="gripper", finger=side)
        scene.contact(side, "b", (0.04 - 0.01 * sign, 0, 0.11), (9 * sign, 0, (G - 1) / 2),
                      normal=(sign, 0, 0))  # fmt: skip
    assert value(scene, "support_margin", "a") == pytest.approx(0.05 - 0.04 / (G + 1), abs=1e-6)
    assert value(scene, "load_share", "b", "a") == pytest.approx(1 / G)


def test_a_wall_beside_it_is_not_stood_on() -> None:
    """Its COM is 2 cm from the side that the wall is on; a third pier there would make it more."""
    scene = Scene(2).fixed("bin").box("a", 0.05, (0, 0, 0.05), com=(0.03, 0, 0))
    scene.rests("a", "bin", 0.05, (0, 0, 0), G)
    scene.contact("bin", "a", [(0.2, -0.05, 0.1), (0.2, 0.05, 0.1)], (-0.5, 0, 0.01),
                  normal=(-1, 0, 0))  # fmt: skip
    assert value(scene, "support_margin", "a") == pytest.approx(0.02, abs=1e-6)


def test_walls_whose_friction_bears_it_are_stood_on() -> None:
    """A wedged book: its support is what spans from wall to wall."""
    scene = Scene(2).fixed("left").fixed("right").box("book", 0.05, (0, 0, 1))
    for name, sign in (("left", 1), ("right", -1)):
        points = [(-0.05 * sign, y, 1.0) for y in (-0.03, 0.03)]
        scene.contact(name, "book", points, (40 * sign, 0, G / 2), normal=(sign, 0, 0))
    assert value(scene, "support_margin", "book") == pytest.approx(0.03, abs=1e-6)
    assert value(scene, "load_share", "book", "left") == pytest.approx(0.5)


def test_what_hardly_presses_on_it_from_below_is_not_stood_on() -> None:
    """A spring beside the post: it counts while it bears a tenth of the weight, and 0.1 s longer."""
    scene = Scene(30).fixed("post").fixed("spring").box("a", 0.05, (0, 0, 0.05), com=(0.01, 0, 0))
    scene.rests("a", "post", 0.02, (0, 0, 0), 0.9 * G)
    for at, share in ((slice(15), 0.11), (slice(15, 30), 0.09)):
        scene.rests("a", "spring", 0.02, (0.03, 0, 0), share * G, frames=at)
    margin = measured(scene, "support_margin", "a").value
    assert np.allclose(margin[:15], 0.02, atol=1e-6)
    assert np.allclose(margin[27:], 0.01, atol=1e-6)


def test_what_presses_down_takes_no_share_of_the_load() -> None:
    scene = Scene(2).fixed("table").box("a", 0.05, (0, 0, 0.05))
    scene.box("palm", 0.02, (0, 0, 0.12), kind="gripper")
    scene.rests("a", "table", 0.05, (0, 0, 0), G + 5)
    scene.contact("palm", "a", (0, 0, 0.1), (0, 0, -5), normal=(0, 0, -1))
    assert value(scene, "load_share", "a", "table") == pytest.approx(1.0)
    assert value(scene, "load_share", "a", "palm") == 0


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


def one_at_a_time(frames: int) -> np.ndarray:
    return np.arange(frames)[:, None] % 4 == np.arange(4)


def test_a_corner_missing_in_single_frames_narrows_no_support() -> None:
    """Without it the middle would lie on the edge of the triangle: a margin of 0."""
    shown = np.ones((60, 4), np.bool_)
    shown[13::13, 2] = False
    found = measured(flickering(shown), "support_margin", "a")
    assert found.known.all() and found.value == pytest.approx(0.03, abs=1e-6)
    gone = np.ones((60, 4), np.bool_)
    gone[20:, 2] = False
    margin = measured(flickering(gone), "support_margin", "a").value
    assert margin[:32] == pytest.approx(0.03, abs=1e-6)
    assert margin[32:] == pytest.approx(0, abs=1e-6)


def test_a_point_that_wanders_around_the_base_spans_it() -> None:
    """One contact per frame, as solvers find for hulls: four frames have all corners, its outline no more."""
    found = measured(flickering(one_at_a_time(60)), "support_margin", "a")
    assert np.isneginf(found.lower[:2]).all()
    assert found.lower[3:] == pytest.approx(0.03, abs=1e-6)
    assert found.upper == pytest.approx(0.03 + OFF, abs=1e-6)
    tipping = measured(flickering(one_at_a_time(60)), "tipping_angle", "a")
    assert tipping.lower[3:] == pytest.approx(np.pi / 4, abs=1e-5)
    assert np.isposinf(tipping.upper).all()


def test_points_that_wander_over_a_part_of_the_base_are_no_verdict() -> None:
    """A corner's neighbourhood alone gives a lower bound only."""
    shown = one_at_a_time(60)
    shown[:, 0] |= shown[:, 3]
    shown[:, 3] = False
    found = measured(flickering(shown), "support_margin", "a")
    assert (found.lower[6:] <= 0.001).all()
    assert found.upper == pytest.approx(0.03 + OFF, abs=1e-6)


def test_what_slides_stands_on_what_it_touches_now() -> None:
    slides = np.arange(60) * 0.002
    found = measured(flickering(one_at_a_time(60), slides), "support_margin", "a")
    assert np.isneginf(found.lower).all()


def test_a_ball_that_rolls_slowly_gets_no_base() -> None:
    """Its points of the last 0.1 s lie within a millimetre, and nothing stands on so little."""
    path = np.column_stack([np.linspace(0, 0.003, 60), 2e-4 * np.sin(np.arange(60)), np.zeros(60)])
    scene = Scene(60).fixed("table")
    scene.body("ball", Geom(kind="sphere", size=(0.035,)), np.add(path, (0, 0, 0.035)))
    for frame, point in enumerate(path):
        scene.contact("table", "ball", [point], (0, 0, G), frames=slice(frame, frame + 1))
    assert np.isneginf(measured(scene, "support_margin", "ball").lower).all()


@given(st.integers(0, 2**32 - 1))
def test_fewer_contacts_never_make_it_stand_more_firmly(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shown = rng.random((40, 4)) < 0.6
    fewer = shown & (rng.random((40, 4)) < 0.8)
    path = np.cumsum(rng.normal(0, 2e-4, 40))
    more = measured(flickering(shown, path), "support_margin", "a")
    less = measured(flickering(fewer, path), "support_margin", "a")
    assert (less.lower <= more.lower + 1e-6).all()


def test_what_hardly_bears_it_bounds_how_firmly_it_stands() -> None:
    """A batten over the end of a wall, one end of it on the table with 5 % of its weight."""
    scene = Scene(2).fixed("table").fixed("wall", (0, -0.5, 0.08), geoms=())
    scene.box("a", (0.03, 0.2, 0.012), (0, 0.005, 0.08))
    scene.contact("wall", "a", [(-0.03, 0, 0.08), (0.03, 0, 0.08)], (0, 0, 0.95 * G))
    alone = measured(scene, "support_margin", "a")
    assert np.isposinf(alone.upper).all() and np.isneginf(alone.lower).all()
    scene.contact("table", "a", [(0, 0.18, 0)], (0, 0, 0.05 * G))
    found = measured(scene, "support_margin", "a")
    assert np.isneginf(found.lower).all()
    assert found.upper == pytest.approx(0.005, abs=1e-6)
    held = (
        Scene(2)
        .fixed("wall", (0, -0.5, 0.08), geoms=())
        .box("palm", 0.02, (0, 0.1, 0), kind="robot")
    )
    held.box("a", (0.03, 0.2, 0.012), (0, 0.005, 0.08))
    held.contact("wall", "a", [(-0.03, 0, 0.08), (0.03, 0, 0.08)], (0, 0, 0.95 * G))
    held.contact("palm", "a", [(0, 0.18, 0)], (0, 0, 0.05 * G))
    assert np.isposinf(measured(held, "support_margin", "a").upper).all()


@given(st.floats(0.02, 0.2), st.floats(0.0, 0.95))
def test_two_contacts_are_bounded_by_the_outline_of_what_bears_them(width: float, part: float):
    """A block that overhangs a table, on one edge of its base: what four corners would give."""
    exact = overhanging(width, part * width)
    few = Scene(2).fixed("table", (-0.5, 0, 0))
    few.box("a", (width / 2, 0.2, 0.05), ((part - 0.5) * width, 0, 0.05))
    few.contact("table", "a", corners(((part - 1) * width, -0.2), (0, 0.2), 0)[1:3], (0, 0, G))
    found = measured(few, "support_margin", "a")
    assert np.isneginf(found.lower).all()
    assert found.upper == pytest.approx(value(exact, "support_margin", "a") + OFF, abs=5e-4)
    assert (found.upper >= value(exact, "support_margin", "a")).all()
    assert np.isposinf(measured(few, "tipping_angle", "a").upper).all()


@given(st.integers(0, 2**32 - 1))
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


def test_what_it_touches_besides_may_bear_it_too() -> None:
    """A wall's outline alone would leave its centre 5 mm outside; the shelf's reaches further."""
    scene = Scene(2).fixed("shelf", (0, 0.6, 0.08)).fixed("wall", (0, -0.5, 0.08))
    scene.box("a", (0.03, 0.2, 0.012), (0, 0.005, 0.092))
    scene.contact("wall", "a", [(-0.03, 0, 0.08), (0.03, 0, 0.08)], (0, 0, 0.95 * G))
    assert measured(scene, "support_margin", "a").upper == pytest.approx(OFF - 0.005, abs=1e-6)
    scene.contact("shelf", "a", [(0, 0.18, 0.08)], (0, 0, 0.05 * G))
    assert measured(scene, "support_margin", "a").upper == pytest.approx(0.005, abs=1e-6)


def test_the_foot_of_a_post_bounds_nothing() -> None:
    """A block beside the middle of a post of 6 cm whose foot is wider, on one edge of its top."""
    foot, pole = (
        Geom(kind="box", size=(half, half, high), position=(0, 0, z))
        for half, high, z in ((0.06, 0.01, 0.01), (0.03, 0.04, 0.06))
    )
    scene = Scene(2).fixed("post", geoms=(foot, pole))
    scene.box("a", 0.05, (0.035, 0, 0.15))
    scene.contact("post", "a", [(0.03, -0.03, 0.1), (0.03, 0.03, 0.1)], (0, 0, G))
    assert measured(scene, "support_margin", "a").upper == pytest.approx(OFF - 0.005, abs=1e-6)


def test_a_plane_bounds_it_by_its_own_outline() -> None:
    scene = Scene(2).fixed("floor", geoms=(Geom(kind="plane", size=(0, 0, 0)),))
    scene.box("a", (0.03, 0.2, 0.012), (0, 0, 0.012))
    scene.contact("floor", "a", [(-0.03, 0.2, 0), (0.03, 0.2, 0)], (0, 0, G))
    assert measured(scene, "support_margin", "a").upper == pytest.approx(0.03 + OFF, abs=1e-6)


@given(st.integers(0, 99))
def test_contacts_that_are_missing_are_found_pair_by_pair_as_in_a_tree(seed):
    rng = np.random.default_rng(seed)
    owner, theirs = np.sort(rng.integers(0, 6, 30)), rng.integers(0, 6, 40)
    points = rng.integers(0, 4, (30, 3)) * firmness.STAYS * 0.9
    others = rng.integers(0, 4, (40, 3)) * firmness.STAYS * 0.9
    far = firmness._far(points, owner, others, theirs)
    assert (far == firmness._far_of_many(points, owner, others, theirs)).all()
    assert far.any()
    assert firmness._far(points[:0], owner[:0], others, theirs).all()
    assert not len(firmness._far(points, owner, others[:0], theirs[:0]))
