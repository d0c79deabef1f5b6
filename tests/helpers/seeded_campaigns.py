"""Mistakes of evaluations, with amounts drawn at random, and the code of the check that names each.

A mistake takes the summaries of a sound campaign and a generator, and gives the campaign with the
mistake in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from safestage_eval.audit.campaign_summary import WAYPOINTS, Campaign, Goal, Summary

POLICIES, TASKS, SEEDS, ROLLOUTS = ("act", "pi0"), ("pour", "stack", "open"), range(5), range(2)

Put = Callable[[list[Summary], np.random.Generator], "Campaign | Sequence[Summary]"]


def sound(seed: int = 0) -> list[Summary]:
    """Two policies on three tasks and five seeds, two rollouts each: nothing is wrong with it."""
    random, scenes = np.random.default_rng(seed), np.random.default_rng(99)
    starts = {cell: scenes.uniform(-0.3, 0.3, (3, 3)) for cell in product(TASKS, SEEDS)}
    found = []
    for policy, task, env, rollout in product(POLICIES, TASKS, SEEDS, ROLLOUTS):
        good = bool(random.random() < 0.5) if policy == "act" else found[len(found) - 30].success
        when = float(random.uniform(5, 9)) if good else None
        end = when + 5.0 if when is not None else 30.0
        places = np.cumsum(random.normal(0, 0.02, (WAYPOINTS, 6, 3)), 0).astype(np.float32)
        start = starts[task, env]
        found.append(
            Summary(
                episode_id=f"{task}.{policy}.s{env}.r{rollout}",
                path=f"runs/{policy}",
                task=task,
                policy=policy,
                prompt="default",
                seed=env,
                rollout=rollout,
                success=good,
                success_time=when,
                termination="success" if good else "horizon",
                horizon=30.0,
                content_hash=f"{random.integers(1 << 62):x}",
                duration=end,
                start=tuple(
                    (name, (*map(float, at), 1.0, 0.0, 0.0, 0.0))
                    for name, at in zip(("cup", "plate", "can"), start, strict=True)
                ),
                waypoints=places.tobytes(),
                stirred=2.5,
                targets=("cup",),
                target_moved=2.6,
                touched=2.2,
                contacts=True,
                robot_travel=0.6,
                commands="varied",
                goal=Goal(when, False, False, False),
                names_goal=True,
            )
        )
    return found


@dataclass(frozen=True)
class Seeded:
    """One kind of mistake: the code that must name it, and what puts it in."""

    code: str
    put: Put
    also: tuple[str, ...] = ()
    """Codes of checks that may report what the mistake brings with it."""


def one(which: Callable[[Summary], bool] = lambda _: True, **changes: Any) -> Put:
    """Some of the episodes that are such get other values; values may be drawn."""

    def put(episodes: list[Summary], random: np.random.Generator) -> list[Summary]:
        fitting = [i for i, e in enumerate(episodes) if which(e)]
        chosen = {*random.choice(fitting, random.integers(1, min(4, len(fitting)) + 1), False)}
        return [
            replace(e, **{k: v(e, random) if callable(v) else v for k, v in changes.items()})
            if i in chosen
            else e
            for i, e in enumerate(episodes)
        ]

    return put


def every(which: Callable[[Summary], bool] = lambda _: True, **changes: Any) -> Put:
    """All that are such get other values."""
    return lambda episodes, random: [
        replace(e, **{k: v(e, random) if callable(v) else v for k, v in changes.items()})
        if which(e)
        else e
        for e in episodes
    ]


def _good(e: Summary) -> bool:
    return bool(e.success)


def _bad(e: Summary) -> bool:
    return not e.success


def _act(e: Summary) -> bool:
    return e.policy == "act"


def _shifted(low: float, high: float) -> Callable[[Summary, np.random.Generator], Any]:
    """One body of the initial state elsewhere, by an amount (m)."""

    def shift(e: Summary, random: np.random.Generator) -> Any:
        (name, pose), *rest = e.start
        return ((name, (pose[0] + float(random.uniform(low, high)), *pose[1:])), *rest)

    return shift


def _turned(e: Summary, random: np.random.Generator) -> Any:
    half = float(random.uniform(0.05, 1.5))
    (name, pose), *rest = e.start
    return ((name, (*pose[:3], float(np.cos(half)), 0.0, 0.0, float(np.sin(half)))), *rest)


def _first_start(episodes: list[Summary], random: np.random.Generator) -> list[Summary]:
    """The seed does not reach the environment: a task always begins as its first seed does."""
    start = {e.task: e.start for e in reversed(episodes)}
    return [replace(e, start=start[e.task]) for e in episodes]


def _two_seeds_alike(episodes: list[Summary], random: np.random.Generator) -> list[Summary]:
    """Two seeds of a task begin alike, for both policies, up to rounding."""
    task = TASKS[random.integers(3)]
    a, b = random.choice(5, 2, False)
    given = next(e.start for e in episodes if (e.task, e.seed) == (task, a))
    near = tuple((n, tuple(float(np.float32(v)) for v in pose)) for n, pose in given)
    return [replace(e, start=near) if (e.task, e.seed) == (task, b) else e for e in episodes]


def _copied(rename: Callable[[Summary], dict[str, Any]], *, again: bool = False) -> Put:
    """A rollout is there once more under another name; ``again``: with another content hash."""

    def put(episodes: list[Summary], random: np.random.Generator) -> list[Summary]:
        e = episodes[random.integers(len(episodes))]
        more = {"content_hash": "f00d"} if again else {}
        return [*episodes, replace(e, episode_id=e.episode_id + "-copy", **rename(e), **more)]

    return put


def _jittered(e: Summary, random: np.random.Generator) -> bytes:
    return (e.places + random.normal(0, 1e-6, e.places.shape).astype(np.float32)).tobytes()


def _deterministic(episodes: list[Summary], random: np.random.Generator) -> list[Summary]:
    """All repetitions of a seed are the same, up to rounding."""
    first = {(e.policy, e.task, e.seed): e for e in reversed(episodes)}
    out = []
    for e in episodes:
        f = first[e.policy, e.task, e.seed]
        out.append(replace(e, waypoints=_jittered(f, random), duration=f.duration))
    return out


def _lost(episodes: list[Summary], random: np.random.Generator) -> Campaign:
    gone = random.choice(len(episodes), random.integers(1, 20), False)
    left = [e for i, e in enumerate(episodes) if i not in gone]
    return Campaign([*left, *(replace(e) for e in ())], 0, [episodes[i].episode_id for i in gone])


def _dropped(episodes: list[Summary], random: np.random.Generator) -> list[Summary]:
    some = [i for i, e in enumerate(episodes) if e.policy == "pi0"]
    gone = {*random.choice(some, random.integers(1, 12), False)}
    return [e for i, e in enumerate(episodes) if i not in gone]


def _better(episodes: list[Summary], random: np.random.Generator) -> list[Summary]:
    """One policy succeeds once or twice more often than the other."""
    failed = [i for i, e in enumerate(episodes) if e.policy == "act" and not e.success]
    chosen = {*random.choice(failed, random.integers(1, 4), False)}
    more = {"success": True, "success_time": 7.0, "goal": Goal(7.0, False, False, False)}
    return [replace(e, **more) if i in chosen else e for i, e in enumerate(episodes)]


def _renumbered(episodes: list[Summary], random: np.random.Generator) -> list[Summary]:
    """Repetitions all have the number 0."""
    return [replace(e, rollout=0) for e in episodes]


def _late(e: Summary, random: np.random.Generator) -> float:
    return float((e.success_time or 0.0) + random.uniform(0.2, 4.0))


EVALUATION: dict[str, Seeded] = {
    "the seed has no effect": Seeded("AUD301", _first_start, ("AUD302",)),
    "two seeds begin alike": Seeded("AUD301", _two_seeds_alike),
    "an object was moved between resets": Seeded("AUD302", one(start=_shifted(0.005, 0.2))),
    "an object was turned between resets": Seeded("AUD302", one(start=_turned)),
    "another policy began later": Seeded("AUD302", every(_act, start=_shifted(0.01, 0.05))),
    "no seed": Seeded("AUD303", every(seed=None)),
    "no policy": Seeded("AUD303", every(policy=None), ("AUD334",)),
    "no task": Seeded("AUD303", every(task=None), ("AUD302", "AUD301")),
    "success before anything moved": Seeded(
        "AUD311", one(_good, stirred=lambda e, r: e.success_time + float(r.uniform(0.1, 3)))
    ),
    "success though nothing ever moved": Seeded(
        "AUD311", one(_good, stirred=None, target_moved=None, touched=None)
    ),
    "success untouched": Seeded("AUD312", one(_good, touched=None)),
    "success before the touch": Seeded("AUD312", one(_good, touched=_late)),
    "the goal holds at once": Seeded("AUD313", one(_good, goal=Goal(0.03, False, True, False))),
    "success is not borne out": Seeded("AUD314", one(_good, goal=Goal(None, False, False, False))),
    "a success was missed": Seeded("AUD314", one(_bad, goal=Goal(8.0, False, False, False))),
    "success_time of another clock": Seeded(
        "AUD314",
        one(_good, goal=lambda e, r: Goal(e.success_time - float(r.uniform(0.2, 4)), False, False, False)),
    ),
    "lost in the hold": Seeded("AUD315", one(_good, goal=lambda e, _: e.goal._replace(undone=True))),
    "success is not recorded": Seeded(
        "AUD316", one(success=None, success_time=None, names_goal=False), ("AUD351", "AUD352")
    ),
    "commands are NaN": Seeded("AUD321", one(commands="missing")),
    "the command never changes": Seeded("AUD321", one(commands="constant")),
    "the robot stands still": Seeded(
        "AUD322", one(_bad, robot_travel=lambda _, r: float(r.uniform(0, 0.004)))
    ),
    "a policy does nothing": Seeded(
        "AUD323",
        every(_act, stirred=None, target_moved=None, touched=None, success=False, success_time=None,
              goal=Goal(None, False, False, False)),
        (),
    ),
    "a policy mostly does nothing": Seeded(
        "AUD323",
        every(lambda e: _act(e) and e.seed < 3, stirred=None, target_moved=None, touched=None,
              success=False, success_time=None, goal=Goal(None, False, False, False)),
        (),
    ),
    "copied under another id": Seeded("AUD331", _copied(lambda _: {"rollout": 7}), ("AUD343",)),
    "copied under another policy": Seeded(
        "AUD331", _copied(lambda e: {"policy": {"act": "pi0", "pi0": "act"}[e.policy], "rollout": 8}),
        ("AUD343",),
    ),
    "copied under another seed": Seeded(
        "AUD331", _copied(lambda _: {"seed": 17}), ("AUD301", "AUD343")
    ),
    "copied and written anew": Seeded(
        "AUD332", _copied(lambda _: {"rollout": 7}, again=True), ("AUD343",)
    ),
    "a deterministic policy": Seeded("AUD332", _deterministic, ("AUD314",)),
    "one id for two": Seeded(
        "AUD333", lambda es, r: [*es[1:], replace(es[0], episode_id=es[1 + r.integers(50)].episode_id)]
    ),
    "all rollouts are number 0": Seeded("AUD334", _renumbered),
    "rollouts are lost": Seeded("AUD341", _lost, ("AUD343", "AUD352")),
    "files are broken": Seeded("AUD341", lambda es, r: Campaign(es, int(r.integers(1, 20)))),
    "ended by an error": Seeded("AUD342", one(_bad, termination="error")),
    "cut off": Seeded("AUD342", one(_bad, termination="truncated")),
    "a policy was tried less often": Seeded("AUD343", _dropped, ()),
    "another horizon": Seeded(
        "AUD344", every(_act, horizon=lambda _, r: 60.0), ()
    ),
    "hardly better": Seeded("AUD351", _better, ("AUD314",)),
    "few rollouts": Seeded(
        "AUD352", lambda es, r: [e for e in es if e.task == "pour" and e.seed < 4], ()
    ),
}  # fmt: skip
"""Name of the mistake → what it is."""
