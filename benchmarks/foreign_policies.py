"""Scripted policies for tasks of other people's simulators: each yields actions from observations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np


def pick_and_place(
    hand: Callable[[], Any],
    thing: Callable[[], Any],
    goal: Callable[[], Any],
    act: Callable[[Any, float], Any],
    *,
    gain: float,
    depth: float = 0.0,
    above: float = 0.1,
    release: bool = True,
    patience: int = 60,
) -> Iterator[Any]:
    """Reach over a thing, grasp it, lift it, carry it over the goal, set it down, let go, withdraw.

    Args:
        hand: (3,) m, place of the fingertips now.
        thing: (3,) m, place of the thing now.
        goal: (3,) m, where the thing is to be.
        act: (3,) command in −1 … 1 and the gripper (1 closes) → the environment's action.
        gain: command per metre.
        depth: m, of the fingertips below the thing's middle at the grasp.
        above: m, height of the way.
        release: whether to let go at the goal.
        patience: steps after which a motion counts as done.
    """

    def move(place: Callable[[], Any], closed: float, near: float) -> Iterator[Any]:
        for _ in range(patience):
            away = place() - hand()
            if np.linalg.norm(away) < near:
                return
            yield act(np.clip(gain * away, -1, 1), closed)

    def wait(closed: float, steps: int) -> Iterator[Any]:
        for _ in range(steps):
            yield act(np.zeros(3), closed)

    up, low = np.array([0, 0, above]), np.array([0, 0, -depth])
    yield from move(lambda: thing() + up, -1, 0.015)
    yield from move(lambda: thing() + low, -1, 0.008)
    yield from wait(1, 12)
    grasp = hand() - thing()
    start = hand().copy()
    yield from move(lambda: start + up, 1, 0.02)
    if not release:
        yield from move(lambda: goal() + grasp, 1, 0.005)
        while True:
            yield act(np.clip(gain * (goal() + grasp - hand()), -1, 1), 1)
    yield from move(lambda: goal() + grasp + up, 1, 0.015)
    yield from move(lambda: goal() + grasp, 1, 0.008)
    yield from wait(-1, 10)
    end = hand().copy()
    yield from move(lambda: end + up, -1, 0.02)
    while True:
        yield act(np.zeros(3), -1)


def push(
    hand: Callable[[], Any],
    thing: Callable[[], Any],
    goal: Callable[[], Any],
    act: Callable[[Any, float], Any],
    *,
    gain: float,
    reach: float = 0.09,
) -> Iterator[Any]:
    """Go behind a thing, seen from its goal, and push it there with closed fingers."""
    while True:
        way = goal() - thing()
        way[2] = 0.0
        far = np.linalg.norm(way)
        if far < 0.02:
            yield act(np.zeros(3), 1)
            continue
        behind = thing() - reach * way / far
        off = behind - hand()
        side = hand() - thing()
        along = float(side @ way) / far
        across = float(np.linalg.norm(side[:2] - along * way[:2] / far))
        if across > 0.03 or along > 0:  # over it, and down behind it
            over = behind + np.array([0, 0, 0.1])
            flat = np.linalg.norm((over - hand())[:2])
            yield act(np.clip(gain * ((over if flat > 0.02 else behind) - hand()), -1, 1), 1)
        elif off[2] < -0.02:
            yield act(np.clip(gain * off, -1, 1), 1)
        else:
            aim = thing() + 0.02 * way / far - hand()
            aim[2] = thing()[2] - hand()[2]
            yield act(np.clip(0.5 * gain * aim, -0.5, 0.5), 1)
