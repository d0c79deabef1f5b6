"""Built-in states, phases and goals on small scenes whose truth is known."""

import numpy as np
import pytest
from scenes import G, Scene

from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import load_rules
from safestage_eval.rules.files import builtin_folder
from safestage_eval.rules.syntax import Call, PhaseSpan
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.scopes import spans

RATE = 120.0
RULES = load_rules([builtin_folder()])
HALF = 0.03


def path(frames: int, *knots: tuple[float, float, float]) -> np.ndarray:
    """(T, 3) m: x and z over time, straight between knots (frame, x, z above the table)."""
    f, x, z = zip(*knots, strict=True)
    t = np.arange(frames)
    return np.stack([np.interp(t, f, x), np.zeros(frames), np.interp(t, f, z) + HALF], 1)


def scene(frames: int, where: np.ndarray) -> Scene:
    """A table, a cube called ``a`` on the path, a gripper with two fingers far away."""
    out = Scene(frames, RATE).fixed("table").box("a", HALF, where)
    for side in ("left", "right"):
        out.box(side, 0.01, (0, 0, 5), kind="gripper", finger=side)
    return out


def stands(scene: Scene, *intervals: tuple[int, int]) -> Scene:
    for first, stop in intervals:
        scene.rests("a", "table", HALF, (0, 0, 0), G, frames=slice(first, stop))
    return scene


def held(scene: Scene, first: int, stop: int) -> Scene:
    for side, normal in (("left", (0, 1, 0)), ("right", (0, -1, 0))):
        force = (0, 5.0 * normal[1], G / 2)
        scene.contact(side, "a", (0, 0, HALF), force, normal, slice(first, stop))
    return scene


def evaluator(scene: Scene, success: int | None = None) -> Evaluator:
    return Evaluator(Relations(Signals(scene.episode())), RULES, RULES.params, success)


def true(evaluator: Evaluator, name: str, *bodies: str) -> np.ndarray:
    return evaluator.holds(Call(name, bodies), {})


def first(truth: np.ndarray) -> int | None:
    return int(np.argmax(truth)) if truth.any() else None


def carried_away(release: float = 0.0, frames: int = 480) -> Scene:
    """Stands until 60, is held from 50, carried 30 cm, let go at 300 from ``release`` m up, falls."""
    fall = int(np.ceil(np.sqrt(2 * release / G) * RATE)) if release else 0
    where = path(frames, (0, 0, 0), (60, 0, 0), (120, 0, 0.2), (240, 0.3, 0.2), (290, 0.3, release))
    t = np.clip((np.arange(frames) - 300) / RATE, 0, None)
    where[:, 2] = np.where(t > 0, np.maximum(HALF, HALF + release - G * t**2 / 2), where[:, 2])
    return held(stands(scene(frames, where), (0, 60), (300 + fall, frames)), 50, 300)


@pytest.mark.parametrize(("release", "dropped"), [(0.01, False), (0.12, True)])
def test_letting_go_from_high_up_is_a_drop(release: float, dropped: bool) -> None:
    found = evaluator(carried_away(release))
    assert true(found, "dropped", "a").any() == dropped
    assert not true(found, "lost", "table", "a").any()  # it had been freed in the hand
    if dropped:
        fallen = first(true(found, "dropped", "a"))
        assert 300 < fallen <= 300 + np.sqrt(2 * release / G) * RATE + 1
        down = 300 + int(np.ceil(np.sqrt(2 * release / G) * RATE))
        assert true(found, "dropped", "a")[fallen : down + 1].all()
        assert not true(found, "dropped", "a")[
            down + 1 :
        ].any()  # it lies there: another fall counts anew


@pytest.mark.parametrize("rate", [60, 120, 240])
@pytest.mark.parametrize(("height", "dropped"), [(0.055, True), (0.045, False)])
def test_a_fall_is_reported_at_any_rate(rate: float, height: float, dropped: bool) -> None:
    """The frame that lands counts: before it a coarse recording has seen only part of the way."""
    frames = int(2 * rate)
    t = np.arange(frames) / rate
    where = np.zeros((frames, 3))
    where[:, 2] = HALF + np.maximum(height - G * np.clip(t - 0.5, 0, None) ** 2 / 2, 0)
    down = int(np.argmax(where[:, 2] <= HALF))
    falls = Scene(frames, rate).fixed("table").fixed("ledge", (0, 0, height))
    falls.box("a", HALF, where)
    falls.rests("a", "ledge", HALF, (0, 0, height), G, frames=slice(0, int(0.5 * rate) + 1))
    falls.rests("a", "table", HALF, (0, 0, 0), G, frames=slice(down, frames))
    for side in ("left", "right"):
        falls.box(side, 0.01, (0, 0, 5), kind="gripper", finger=side)
    assert true(evaluator(falls), "dropped", "a").any() == dropped


def test_falling_over_counts_unless_it_is_held() -> None:
    angle = np.clip((np.arange(240) - 60) / 60, 0, 1) * np.pi / 2
    turned = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0 * angle, 0 * angle], 1)
    tipped = Scene(240, RATE).fixed("table")
    tipped.body("a", scene(1, path(1, (0, 0, 0))).bodies[1].geoms[0], (0, 0, HALF), turned)
    for side in ("left", "right"):
        tipped.box(side, 0.01, (0, 0, 5), kind="gripper", finger=side)
    stands(tipped, (0, 240))
    assert first(true(evaluator(tipped), "toppled", "a")) == pytest.approx(80, abs=1)
    assert true(evaluator(tipped), "lost", "table", "a").any()
    held(tipped, 0, 240)
    assert not true(evaluator(tipped), "toppled", "a").any()
    assert first(true(evaluator(tipped), "committed", "a")) is None  # it turns on the spot


@pytest.mark.parametrize(
    ("knots", "at"),
    [
        ([(60, 0, 0), (120, 0, 0.06)], 60 + 10),  # 1 cm of lift
        ([(60, 0, 0), (120, 0.06, 0)], 60 + 20),  # 2 cm of displacement
        ([(60, 0, 0), (120, 0.015, 0)], None),
    ],
)
def test_commitment(knots: list[tuple[float, float, float]], at: int | None) -> None:
    moved = stands(scene(240, path(240, (0, 0, 0), *knots)), (0, 240))
    held(moved, 20, 60)  # approach and grasp do not commit
    found = first(true(evaluator(moved), "committed", "a"))
    assert found == (None if at is None else pytest.approx(at, abs=2))


def test_in_transit_from_the_onset_to_the_rest_after_release() -> None:
    found = evaluator(carried_away(0.12))
    transit = true(found, "in_transit", "a")
    landed = 300 + np.sqrt(2 * 0.12 / G) * RATE
    assert first(transit) == pytest.approx(60, abs=2)
    assert transit[62 : int(landed)].all()
    rests = landed + 0.1 * RATE  # once it has gone nowhere for 0.1 s
    assert not transit[int(rests) + 5 :].any()


def test_settling() -> None:
    def settle(found: Evaluator) -> list[tuple[int, int]]:
        return [(s.first, s.stop) for s in spans(found, PhaseSpan(Call("settle", ("a",))), {})]

    still = evaluator(stands(scene(480, path(480, (0, 0, 0))), (0, 480)))
    assert settle(still) == []  # never moved
    put_down = carried_away()
    assert settle(evaluator(put_down)) == [(360, 480)]  # the last second
    long = carried_away(frames=320 + 600)
    assert settle(evaluator(long, success=310)) == [(310 + 480, 310 + 600)]
    kept = held(
        stands(scene(480, path(480, (0, 0, 0), (60, 0, 0), (120, 0.3, 0.2))), (0, 60)), 50, 480
    )
    assert settle(evaluator(kept)) == []  # still held at the horizon
