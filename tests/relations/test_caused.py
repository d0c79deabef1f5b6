"""Bodies that the robot moved: touched by it, or by what it had touched before."""

import numpy as np
from scenes import Scene
from told import doubt_of, holds, why_unknown

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
    truth = holds(relations, "caused", (name,))
    doubt = doubt_of(relations, "caused", (name,))
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
    assert "poses of the robot" in why_unknown(relations, "caused", ("a",))


def may_be(made: Scene, name: str, **header: object) -> str:
    """A letter per frame: 1, 0 or ? (unknown)."""
    relations = Relations(Signals(made.episode(**header)))
    truth = holds(relations, "may_be_caused", (name,))
    doubt = doubt_of(relations, "may_be_caused", (name,))
    open_ = np.zeros(FRAMES, np.bool_) if doubt is None else doubt[0]
    return "".join("?" if o else str(int(x)) for x, o in zip(truth, open_, strict=True))


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
    sure, doubt = holds(relations, "caused", ("b",)), doubt_of(relations, "caused", ("b",))
    may = holds(relations, "may_be_caused", ("b",))
    assert sure is not None
    assert may is not None
    open_ = sure if doubt is None else sure | doubt[0]
    assert (may | ~open_).all()
