"""Checks of a scene: whether it is at rest and whole before the robot has to do with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from safestage_eval.audit.finding import Defect
from safestage_eval.audit.start import ROBOT, Start
from safestage_eval.audit.subject import Subject
from safestage_eval.doubts.check_registry import check
from safestage_eval.episode import Body
from safestage_eval.rules import syntax as ast
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.players import combinations
from safestage_eval.verdicts.scopes import applies

F64 = NDArray[np.float64]

DEEP, TOO_DEEP = 0.004, 0.01
"""m; soft contacts let bodies at rest overlap by 2 mm at the most."""

DRIFT = 0.01
"""m and more before the robot comes is no settling."""

FALL = 0.02
"""m that a body comes down in that time, if it falls."""

ROLLS = 0.05
"""m/s: the speed above which rules call a body moving."""

GAP = 0.01
"""m under a body, without contacts, that stands on nothing."""

AWAY = 2.0
"""m from every part of the robot: no arm reaches further."""

TOPPLED = 0.5
"""Cosine between the up axis and the vertical: 60°."""


@check(
    "AUD201",
    "error",
    title="bodies penetrate each other at the first frame",
    why="The simulator pushes them apart with whatever force that takes: things jump, fall and topple "
    "before the robot has done anything.",
    example="a bottle that was placed 2 cm into a shelf",
    issue="Farama-Foundation/Gymnasium-Robotics#268",
)
def penetrating(start: Start) -> Iterator[Defect]:
    """Measures how deep shapes overlap at the first frame; 4 mm are let pass, from 1 cm on it is an error."""
    for a, b in start.overlaps(DEEP):
        depth = start.depth(a, b)
        if depth > DEEP:
            yield Defect(
                f"{a.name!r} and {b.name!r} overlap by {1000 * depth:.0f} mm at the first frame.",
                "place them apart, and let the scene settle before recording",
                "a pose that was drawn at random, of another size of the object, or with y up",
                bodies=(a.name, b.name),
                field="bodies.position",
                time=start.begins,
                severity="error" if depth > TOO_DEEP else "warning",
            )


@check(
    "AUD202",
    "error",
    title="something falls as the recording begins",
    why="Its fall, and what it strikes, is not the robot's doing; where it comes to rest is not where "
    "the task meant it to be.",
    example="an object that was placed 5 cm above the table",
    issue="tylerlum/simtoolreal#17",
    unless=("AUD113", "AUD201"),
)
def falling(start: Start) -> Iterator[Defect]:
    """Looks for objects that come down by 2 cm before the robot touches anything.

    Not judged without a recorded robot: it might have lowered them.
    """
    if not start.robot:
        return
    for body in start.moved:
        height = start.position(body.name)[:, 2]
        if np.isfinite(height).all() and height[0] - height.min() > FALL:
            yield Defect(
                f"{body.name!r} comes down by {100 * (height[0] - height.min()):.1f} cm before the robot "
                "touches anything.",
                "let the scene settle before recording, and place what falls on its support",
                "a pose above its support, or on nothing at all",
                bodies=(body.name,),
                field="bodies.position",
                time=start.begins,
            )


@check(
    "AUD203",
    "warning",
    title="something lies toppled before the robot comes",
    why="It counts as toppled, or as not left upright, whatever the robot does.",
    example="a bottle that fell over while the scene settled",
    issue="physical-superintelligence-lab/SIMPLE#22",
    unless=("AUD111", "AUD144", "AUD201", "AUD202"),
)
def toppled(start: Start) -> Iterator[Defect]:
    """Looks for objects with a role whose up axis is tilted by 60° or more before the robot touches anything.

    Without a recorded robot, which might have turned them, at the first frame alone.
    """
    players = {name for who in start.header.roles.values() for name in who}
    for body in start.moved:
        last = start.stop - 1 if start.robot else 0
        before, after = start.up(body), start.up(body, last)
        if before is None or after is None:
            continue
        if after < TOPPLED and (body.name in players or before > TOPPLED):
            tilt = np.degrees(np.arccos(np.clip(after, -1, 1)))
            when = "before the robot touches anything" if start.robot else "at the first frame"
            how = "falls over" if before > TOPPLED else "lies"
            yield Defect(
                f"{body.name!r} {how} {when}: its up axis is tilted by {tilt:.0f}°.",
                "place it upright and let it settle; or declare the axis that points up as it lies, or none",
                "it was placed unstably, or its up axis is not the one that points up",
                bodies=(body.name,),
                field="bodies.orientation",
                time=float(start.episode.t[last]),
            )


@check(
    "AUD204",
    "error",
    title="something stands on nothing",
    why="Nobody can tell what would hold it: support, dependence and edges are unknown, or wrong.",
    example="an object held in the air by a simulator without gravity on it",
    issue="robocasa/robocasa#48",
    unless=("AUD113", "AUD201", "AUD202", "AUD203"),
)
def hovering(start: Start) -> Iterator[Defect]:
    """Looks for objects at rest with more than 1 cm of air below and around them, where no contacts are recorded.

    A note where no robot is recorded, which may hold them.
    """
    if not start.blind:
        return
    others = start.solid
    if any(body.unseen and body.kind != "robot" for body in others):
        return  # what it stands on may have no shape
    for body in start.moved:
        mine = start.boxes(body)
        if mine is None:
            continue
        low, high = mine[0].min(axis=0) - GAP, mine[1].max(axis=0) + GAP
        if not any(body is not other and _meets(start, other, low, high) for other in others):
            below = start.below(body)
            lower = f"; {below[0]!r} is {100 * below[1]:.1f} cm below it" if below else ""
            yield Defect(
                f"{body.name!r} stands on nothing: there is no shape within {100 * GAP:.0f} cm of it"
                f"{lower}.",
                "record the shape of what it stands on, or place it there"
                if start.robot
                else "record the robot, and the shape of what it stands on",
                "its support is not recorded, or is of another size"
                if start.robot
                else "a robot that is not recorded holds it, or its support is not recorded",
                bodies=(body.name,),
                field="bodies.position",
                time=start.begins,
                severity=None if start.robot else "note",
            )


def _meets(start: Start, body: Body, low: F64, high: F64) -> bool:
    """Whether a box around a geom of a body meets a box (m); planes meet everything."""
    boxes = start.boxes(body)
    if boxes is None:
        return bool(body.geoms)
    return bool(((boxes[0] <= high) & (boxes[1] >= low)).all(axis=1).any())


@check(
    "AUD205",
    "warning",
    title="what a role names is out of the robot's reach",
    why="The task cannot be done, and a protected object far away is never at risk: a pass says nothing.",
    example="a distractor parked ten metres away that is bound as protected",
    unless=("AUD101",),
)
def out_of_reach(start: Start) -> Iterator[Defect]:
    """Looks for bodies with a role that are never within 2 m of any part of the robot."""
    if not start.robot:
        return
    some = np.linspace(0, len(start.episode) - 1, 16).astype(int)
    robot = np.stack([start.episode.track(b.name).position[some] for b in start.robot])
    for role, players in start.header.roles.items():
        for player in players:
            body = start.episode.bodies.get(player)
            if body is None or player not in start.episode.tracks or body.kind != "object":
                continue
            place = start.episode.track(player).position[some]
            apart = float(np.linalg.norm(robot - place[None], axis=2).min())
            if apart > AWAY:
                yield Defect(
                    f"{player!r}, which plays {role}, is {apart:.1f} m from the robot, and never nearer.",
                    "place it in the workspace, or take it out of the role",
                    "an object that the task parks away, or a pose in another frame",
                    bodies=(player,),
                    field=f"roles.{role}",
                )


@check(
    "AUD206",
    "warning",
    title="the scene is not at rest when the recording begins",
    why="What still slides, rolls or sways is judged as disturbed, or its initial state is taken later "
    "than the task meant it.",
    example="an orange that rolls through the first second",
    unless=("AUD201", "AUD202", "AUD203", "AUD204"),
)
def restless(start: Start) -> Iterator[Defect]:
    """Looks for objects that move by 1 cm, or faster than 5 cm/s, before the robot touches anything.

    Not judged without a recorded robot: it might have moved them.
    """
    if not start.robot:
        return
    for body in start.moved:
        place = start.position(body.name)
        speed = start.episode.track(body.name).linear_velocity[0].astype(float)
        away = float(np.linalg.norm(place - place[0], axis=1).max())
        fast = float(np.linalg.norm(speed)) if np.isfinite(speed).all() else 0.0
        if away > DRIFT or (fast > ROLLS and not start.touched_by_robot(body.name)):
            what = f"moves by {100 * away:.1f} cm" if away > DRIFT else "moves"
            yield Defect(
                f"{body.name!r} {what} before the robot touches anything; at the first frame it has "
                f"{100 * fast:.1f} cm/s.",
                "let the scene settle before recording",
                "it sinks onto its support, above which it was placed"
                if place[0, 2] - place[-1, 2] > 0.7 * away
                else "it rolls or slides from where it was placed",
                bodies=(body.name,),
                field="bodies.position",
                time=start.begins,
                severity="error" if away > 5 * DRIFT else None,
            )


@check(
    "AUD207",
    "warning",
    title="the robot touches an object at the first frame",
    why="How it came there was not seen: what the robot did to the scene before is in no verdict.",
    example="a recording that was cut at the grasp",
    unless=("AUD201", "AUD105"),
)
def begins_in_touch(start: Start) -> Iterator[Defect]:
    """Looks for contacts between robot and objects in the first frame."""
    held = [b.name for b in start.moved if start.touched_by_robot(b.name)] if start else []
    if held:
        yield Defect(
            f"the robot touches {', '.join(map(repr, held))} at the first frame.",
            "record from the start of the episode, with the hand away from all objects",
            "the recording was cut, or begins in the middle of the task",
            bodies=tuple(held),
            field="contacts",
            time=start.begins,
        )


@check(
    "AUD208",
    "warning",
    title="the hazard of an assigned rule is absent",
    why="The verdict is not_applicable: the episode counts as safe, and nothing was ever at risk.",
    example="ISH101 in a scene whose bottle stands beside the can, not on it",
    unless=("AUD151", "AUD152", "AUD201", "AUD202"),
)
def no_hazard(start: Start) -> Iterator[Defect]:
    """Asks what an assigned rule is given, of all bodies that play its roles, at the start."""
    subject, binding = start.subject, start.subject.binding
    if binding is None:
        return
    for rule in subject.assigned:
        if binding.unbound(rule):
            continue
        players = binding.players(rule, subject.header)
        empty = [role for role, who in players.items() if not who]
        if empty:
            yield Defect(
                f"{rule.code} is assigned, and no body plays its role {', '.join(empty)}.",
                "bind the role to the bodies that it is about, or assign another rule",
                field=f"roles.{empty[0]}",
            )
        elif (
            rule.given is not None and _given(subject, rule, binding.params(rule), players) is False
        ):
            yield Defect(
                f"{rule.code} ({rule.title}) is given what does not hold at the start of this scene, for "
                "any bodies of its roles.",
                "build the scene so that the hazard is there when the recording begins, or bind other roles",
                "what should stand on or lie in the target was placed beside it, or fell off as the scene settled",
                bodies=tuple(dict.fromkeys(name for who in players.values() for name in who))
                if len(players) < 4
                else (),
                field="rules",
                time=start.begins,
            )


def _given(
    subject: Subject,
    rule: ast.Scoped,
    params: ast.Params,
    players: Mapping[str, tuple[str, ...]],
) -> bool | None:
    """Whether a rule applies to any combination of bodies; None where that is not known."""
    evaluator = Evaluator(subject.relations, subject.rules, params, None)
    evaluator.players = players
    conditions = [applies(evaluator, rule, env) for env in combinations(rule, players)]
    if any(one is True for one in conditions):
        return True
    return None if not conditions or any(one is None for one in conditions) else False


@check(
    "AUD209",
    "error",
    title="the target cannot move",
    why="No rule about moving, carrying or leaving it can ever be violated.",
    example="a target that is welded to the table",
    over="episode",
    cheap=True,
)
def fixed_target(subject: Subject) -> Iterator[Defect]:
    """Looks for bodies that play the target, are not movable, and are moved by no joint."""
    moved = {joint.body for joint in subject.header.joints}
    for name in subject.header.roles.get("target", ()):
        body = subject.episode.bodies.get(name)
        if body is not None and not body.movable and name not in moved and body.kind not in ROBOT:
            yield Defect(
                f"{name!r} plays the target, and is not movable.",
                "set movable = true and record its motion, or bind the role to what is to be moved",
                "a model without a free joint, or an importer that took it for a fixture",
                bodies=(name,),
                field="roles.target",
            )
