"""RoboLab's measures of a motion, and its scores of subtasks, on SafeStage's traces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from asked import Asked
from numpy.typing import NDArray
from peer_code import functions
from resampled import resampled
from tally import Tally

from safestage_eval.episode import Episode
from safestage_eval.rules import RuleSet
from safestage_eval.rules.episode_binding import bind_episode
from safestage_eval.verdicts.judging import Judge

FILE = "robolab/core/metrics/trajectory_metrics.py"
NAMES = [
    "compute_ee_path_length", "compute_ee_isj_from_position", "compute_ee_sparc_from_position",
    "compute_joint_isj_from_velocity", "compute_sparc", "compute_sparc_per_joint",
]  # fmt: skip


def measures(checkout: Path, episode: Episode, rules: RuleSet, rate: float, tally: Tally) -> None:
    """Way, jerk and spectral arc length of the gripper's first body and of the arm, at RoboLab's rate."""
    numpy = SimpleNamespace(**{name: getattr(np, name) for name in dir(np)})
    numpy.trapz = np.trapezoid  # its name before NumPy 2
    theirs = functions(checkout / FILE, NAMES, {"np": numpy})
    thin = resampled(episode, np.arange(0, len(episode), max(1, round(1 / (rate * episode.dt)))))
    if len(thin) < 3:
        return
    tool = next((b for b in thin.header.bodies if b.kind == "gripper"), None)
    bodies = tuple(
        b.model_copy(update={"tags": (*b.tags, "tool")}) if b is tool else b
        for b in thin.header.bodies
    )
    tagged = replace(thin, header=thin.header.model_copy(update={"bodies": bodies}))
    judge = Judge(tagged, rules, bind_episode(rules, tagged.header))
    dt = thin.dt
    if tool is not None:
        position = thin.track(tool.name).position
        _compare(judge, "RLB201", theirs[NAMES[0]](position), tally, NAMES[0])
        _compare(
            judge, "RLB202", theirs[NAMES[1]](position, dt), tally, NAMES[1], _ends(position, dt, 3)
        )
        _compare(judge, "RLB204", -theirs[NAMES[2]](position, dt), tally, NAMES[2])
    arm = [
        i
        for i, joint in enumerate(thin.header.joints)
        if joint.body and thin.bodies[joint.body].kind == "robot"
    ]
    velocity = thin.frames.joint_velocity
    if arm and velocity.shape[1]:
        velocity = velocity[:, arm]
        _compare(
            judge, "RLB203", theirs[NAMES[3]](velocity, dt), tally, NAMES[3], _ends(velocity, dt, 2)
        )
        _compare(judge, "RLB205", -theirs[NAMES[5]](velocity, dt).sum(), tally, NAMES[5])


def _ends(values: NDArray[Any], dt: float, times: int) -> float:
    """By how much the trapezoidal rule, which they use, exceeds our sum: half the first squared jerk less half the last, times dt."""
    jerk = values.astype(float)
    for _ in range(times):
        jerk = np.gradient(jerk, dt, axis=0)
    squared = (jerk**2).sum(axis=1)
    return float(squared[0] - squared[-1]) * dt / 2


def _compare(
    judge: Judge, rule: str, theirs: float, tally: Tally, function: str, ends: float = 0.0
) -> None:
    """To a thousandth, and the 1 mm of a way; ``ends``: what is theirs at both ends of the recording."""
    total = judge.cost(judge.rules.costs[rule])[0]
    known = total.value is not None and total.most is not None
    ours = float(total.value or 0.0) if known else np.nan
    theirs = float(theirs)
    one = tally.count(rule, function, "values")
    one.run += 1
    within = 1e-3 * max(1.0, abs(theirs))
    if abs(ours - theirs) <= within or (not known and not np.isfinite(theirs)):
        one.agreed += 1
    elif ends and abs(ours + ends - theirs) <= within:
        one.differences["half of the first and the last sample, by trapezoids there"] += 1
    else:
        one.differences["unknown here" if not known else "unexplained"] += 1


def score(peer: SimpleNamespace, scene: Any, rules: RuleSet, tally: Tally) -> None:
    """The score of pick_and_place of each target, step by step, beside ``placing_score``."""
    episode, world = scene.episode, scene.env
    asked = Asked(episode, rules)
    roles = episode.header.roles
    for goal in roles.get("destination", []):
        if goal not in scene.world._untransformed_hull_cache or episode.bodies[goal].cavity is None:
            continue
        for body in [b for b in roles.get("target", []) if b in scene.objects and b != goal]:
            task = peer.conditionals.pick_and_place(body, goal)
            before = world.num_envs
            machine = peer.conditionals_state_machine.ConditionalsStateMachine(
                world, 0, task, [body]
            )
            reached = []
            for row in range(len(scene.rows)):
                scene.at, world.num_envs = slice(row, row + 1), 1
                machine.step()
                reached.append(machine.total_score)
            scene.at, world.num_envs = slice(None), before
            theirs = np.array(reached) > 0.5
            ours = asked(f"placing_score({body}, {goal})")[scene.rows]
            tally.frames(ours, theirs, "RLB301", "ConditionalsStateMachine.total_score",
                         [("object_in_container there beside inside() here", np.ones(len(theirs), bool))])  # fmt: skip
