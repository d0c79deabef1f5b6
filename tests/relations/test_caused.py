"""Bodies that the robot moved: touched by it, or by what it had touched before."""

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations

FRAMES = 12


def scene(names: str = "ab", **fields: object) -> Scene:
    found = Scene(FRAMES, 120).fixed("table")
    for i, name in enumerate(names):
        found.box(name, 0.01, (i, 0, 5))
    for side in ("left", "right"):
        found.box(side, 0.01, (0, 9, 5), kind="gripper", finger=side)
    return found


def touch(made: Scene, by: str, on: str, *frames: int) -> None:
    for frame in frames:
        made.contact(by, on, (0, 0, 5), (0, 0, 1), frames=slice(frame, frame + 1))


def caused(made: Scene, name: str, **header: object) -> str:
    """A letter per frame: 1, 0 or ? (unknown)."""
    relations = Relations(Signals(made.episode(**header)))
    truth = relations.get("caused", (name,))
    assert truth is not None
    doubt = relations.doubtful("caused", (name,))
    open_ = np.zeros(FRAMES, np.bool_) if doubt is None else doubt[0]
    return "".join("?" if o else str(int(x)) for x, o in zip(truth, open_, strict=True))


def since(frame: int) -> str:
    return "0" * frame + "1" * (FRAMES - frame)


def test_a_touch_by_the_robot_causes_for_good() -> None:
    made = scene()
    touch(made, "left", "a", 4)
    assert caused(made, "a") == since(4)
    assert caused(made, "b") == since(FRAMES)


def test_what_was_touched_passes_it_on_from_then() -> None:
    made = scene("abc")
    touch(made, "a", "b", 2)
    touch(made, "left", "a", 4)
    touch(made, "a", "c", 6)
    assert caused(made, "b") == since(FRAMES)
    assert caused(made, "c") == since(6)


def test_what_stands_on_a_tray_that_is_touched_is_in_it_at_once_and_on_the_table_is_not() -> None:
    made = scene("ab").box("tray", 0.1, (0, 0, 4))
    touch(made, "tray", "a", *range(FRAMES))
    touch(made, "table", "b", *range(FRAMES))
    touch(made, "table", "tray", *range(FRAMES))
    touch(made, "right", "tray", 5)
    assert caused(made, "a") == since(5)
    assert caused(made, "b") == since(FRAMES)


@pytest.mark.parametrize("opens", [True, False])
def test_a_drawer_passes_on_what_moves_it(opens: bool) -> None:
    made = scene("a")
    way = np.zeros((FRAMES, 3))
    way[6:, 0] = 0.01 if opens else 0.0
    made.box("drawer", 0.1, way, kind="fixture", parent="cabinet")
    touch(made, "drawer", "a", *range(FRAMES))
    touch(made, "left", "drawer", 3)
    assert caused(made, "a") == since(6 if opens else FRAMES)


def test_a_touch_between_two_frames_counts() -> None:
    made = scene()
    touch(made, "left", "a", 4)
    made._rows[-1] = (*made._rows[-1][:5], np.zeros(3))
    episode = made.episode()
    episode.contacts.peak_force[:] = 2.0
    found = Relations(Signals(episode)).get("caused", ("a",))
    assert found is not None
    assert found.tolist() == [c == "1" for c in since(4)]


def test_between_samples_far_apart_a_hand_that_passes_by_may_have_touched() -> None:
    def passing(rate: float, **header: object) -> str:
        made = Scene(FRAMES, rate).fixed("table").box("a", 0.01, (0, 0, 0.01))
        touch(made, "table", "a", *range(FRAMES))
        x = np.linspace(-1.1, 1.1, FRAMES)  # 20 cm from frame to frame
        way = np.stack([x, 0 * x, 0 * x + 0.01], 1)
        for side in ("left", "right"):
            made.box(side, 0.01, way, kind="gripper", finger=side)
        return caused(made, "a", **header)

    assert passing(10, physics_dt=1 / 500) == "0" * 6 + "?" * 6
    assert passing(10, physics_dt=0.1) == since(FRAMES)


def test_without_a_robot_in_the_trace_nobody_knows() -> None:
    made = Scene(FRAMES).fixed("table").box("a", 0.01, (0, 0, 0.01))
    relations = Relations(Signals(made.episode()))
    assert relations.get("caused", ("a",)) is None
    assert relations.lacking("caused", ("a",)) == "poses of the robot"


def may_be(made: Scene, name: str, **header: object) -> str:
    """A letter per frame: 1, 0 or ? (unknown)."""
    relations = Relations(Signals(made.episode(**header)))
    truth = relations.get("may_be_caused", (name,))
    assert truth is not None
    doubt = relations.doubtful("may_be_caused", (name,))
    open_ = np.zeros(FRAMES, np.bool_) if doubt is None else doubt[0]
    return "".join("?" if o else str(int(x)) for x, o in zip(truth, open_, strict=True))


@pytest.mark.parametrize("at", [None, 0, 4, 11])
def test_where_touches_are_known_may_be_caused_is_caused(at: int | None) -> None:
    made = scene()
    if at is not None:
        touch(made, "left", "a", at)
    assert may_be(made, "a") == caused(made, "a")


def test_without_a_robot_what_lay_still_was_moved_and_what_slides_from_the_start_is_open() -> None:
    at = np.zeros((FRAMES, 3))
    at[:, 2] = 0.01
    lies = Scene(FRAMES, 20).fixed("table").box("a", 0.01, at)
    assert may_be(lies, "a") == "??" + "1" * (FRAMES - 2)
    slides = at + np.linspace(0, 0.3, FRAMES)[:, None] * [1, 0, 0]
    assert may_be(Scene(FRAMES, 20).fixed("table").box("a", 0.01, slides), "a") == "?" * FRAMES


def test_a_force_that_was_not_measured_may_be_the_robots() -> None:
    made = scene()
    touch(made, "left", "a", 3)
    touch(made, "table", "b", *range(FRAMES))
    episode = made.episode()
    episode.contacts.force[:] = np.where(
        (episode.contacts.frame == 3)[:, None], np.nan, episode.contacts.force
    )
    relations = Relations(Signals(episode))
    sure, doubt = relations.get("caused", ("b",)), relations.doubtful("caused", ("b",))
    may = relations.get("may_be_caused", ("b",))
    assert sure is not None
    assert may is not None
    open_ = sure if doubt is None else sure | doubt[0]
    assert (may | ~open_).all()


def test_without_forces_what_comes_near_touches() -> None:
    made = Scene(FRAMES).fixed("table").box("a", 0.01, (0, 0, 0.01))
    x = np.full(FRAMES, 0.2)
    x[7:] = 0.0205
    for side in ("left", "right"):
        made.box(side, 0.01, np.stack([x, 0 * x, 0 * x + 0.01], 1), kind="gripper", finger=side)
    assert caused(made, "a", force_source="none") == since(7)
