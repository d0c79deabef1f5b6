"""OopsieVerse's evaluators of damage on traces, and its tables of parameters."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from asked import Asked, with_states
from numpy.typing import NDArray
from peer_code import code_of
from resampled import resampled
from scipy.spatial.transform import Rotation
from tally import Tally

from safestage_eval.episode import Episode
from safestage_eval.rules import load_rules
from safestage_eval.rules.files import builtin_folder
from safestage_eval.signals.damage import STEADY
from safestage_eval.sketch import resolve
from safestage_eval.verdicts import judge

STEP = 0.05
"""s: one evaluation per control step."""

RULES = with_states(
    "oopsieverse",
    """
[state.still_sound]
of   = ["a"]
when = { "hp(a)" = ">= sound(a)" }
[state.alive]
of   = ["a"]
when = { "hp(a)" = "> 0 %" }
""",
)
RULES_ALONE = load_rules(["oopsieverse"])
CODE = "generate_damage"
DAMAGED = ("object", "robot", "gripper")
"""Kinds of bodies that the evaluators look at: objects and links."""


@contextmanager
def comparing(checkout: Path) -> Iterator[Callable[[Episode | None, Tally], None]]:
    """Health of every object, each made of another of its materials in every episode."""
    packages = ["damagesim", "damagesim.core", "damagesim.core.evaluators", "damagesim.robosuite", "damagesim.robosuite.params"]  # fmt: skip
    absent = ["robosuite", "robocasa", "mujoco", "omnigibson", "damagesim.robosuite.evaluators"]
    with code_of(checkout, packages, absent):
        names = ("core.evaluators.mechanical", "core.evaluators.thermal", "core.evaluators.electrical",
                 "robosuite.params.damage_params")  # fmt: skip
        peer = SimpleNamespace(
            **{n.split(".")[-1]: importlib.import_module(f"damagesim.{n}") for n in names}
        )
        params = peer.damage_params.OBJECT_PARAMS
        rows = [name for name in RULES.materials if name in params and "mechanical" in params[name]]
        turn = [0]

        def compare(episode: Episode | None, tally: Tally) -> None:
            if episode is None:
                _parameters(params, rows, tally)
                _thermal_and_electrical(peer, tally)
                return
            step = max(1, round(STEP / episode.dt))
            thin = resampled(episode, np.arange(0, len(episode), step))
            bodies = []
            for body in thin.header.bodies:
                worn = body.kind in DAMAGED
                turn[0] += worn
                made = {"material": rows[turn[0] % len(rows)]} if worn else {}
                bodies.append(body.model_copy(update=made))
            _mechanical(peer, replace(thin, header=thin.header.model_copy(update={"bodies": tuple(bodies)})), params, tally)  # fmt: skip

        yield compare


def _parameters(params: dict[str, Any], rows: list[str], tally: Tally) -> None:
    keys = {
        "damage_threshold": "damage_threshold", "damage_scale": "damage_scale",
        "impact_sensitivity": "impact_damage_sensitivity", "hold_sensitivity": "qs_damage_sensitivity",
    }  # fmt: skip
    for row in rows:
        mine = RULES.materials[row]
        for ours, theirs in keys.items():
            value = np.array([mine[ours].value])
            tally.values(value, np.array([params[row]["mechanical"][theirs]]), "[material]", "OBJECT_PARAMS", 1e-9)  # fmt: skip
        if params[row].get("health_thresholds"):
            limit = params[row]["health_thresholds"][0] / 100
            tally.values(np.array([mine["sound"].value]), np.array([limit]), "[material]", "OBJECT_PARAMS", 1e-9)  # fmt: skip


def _mechanical(
    peer: SimpleNamespace, episode: Episode, params: dict[str, Any], tally: Tally
) -> None:
    asked, table = Asked(episode, RULES), episode.contacts
    for index, body in enumerate(episode.header.bodies):
        if body.kind not in DAMAGED or not body.mass:
            continue
        track = episode.track(body.name)
        lever = Rotation.from_quat(track.orientation, scalar_first=True).apply(np.asarray(body.com))
        velocity = track.linear_velocity + np.cross(track.angular_velocity, lever)
        forces: dict[int, list[dict[str, Any]]] = {}
        for row in np.flatnonzero((table.body1 == index) | (table.body2 == index)):
            normal = table.normal[row].astype(float)
            force = (
                normal * float(table.force[row] @ normal) * (1 if table.body2[row] == index else -1)
            )
            forces.setdefault(int(table.frame[row]), []).append(
                {"force": force, "magnitude": float(np.linalg.norm(force))}
            )
        now = SimpleNamespace(frame=0, velocity=velocity)

        class Traced(peer.mechanical.MechanicalDamageEvaluator):  # type: ignore[misc, name-defined]
            """The evaluator, reading a trace."""

            _get_damageable_part_names = lambda _: ["body"]  # noqa: E731
            _get_part_linear_velocity = lambda _, __: now.velocity[now.frame]  # noqa: E731, B023
            _get_part_contacts = lambda _, __: forces.get(now.frame, [])  # noqa: E731, B023
            _get_timestep = lambda _: episode.dt  # noqa: E731
            _get_part_mass = lambda _, __: body.mass  # noqa: E731, B023

        def health_left(velocity: NDArray[Any], material: str = str(body.material)) -> float:
            now.velocity, health = velocity, 100.0  # noqa: B023
            evaluator = Traced(None, **params[material]["mechanical"])
            for frame in range(len(episode)):
                now.frame = frame  # noqa: B023
                health = max(0.0, health - evaluator.generate_damage()["body"])
            return health

        least = health_left(velocity)
        bound = params[str(body.material)].get("health_thresholds", [90.0])[0]
        rules = [("still_sound", "OOP101", bound), ("alive", "OOP102", 0.0)]
        if body.kind != "object":
            rules = [("still_sound", "OOP103", bound)]
        for state, rule, limit in rules:
            ours = asked(f"{state}({body.name})")
            theirs = least < limit if limit else least <= 0
            said = "inconclusive" if np.isnan(ours).any() and not (ours == 0).any() else (
                "violation" if (ours == 0).any() else "pass"
            )  # fmt: skip
            why = "within 1 point" if abs(least - limit) < 1.0 else "unexplained"
            if (said == "violation") != theirs and why == "unexplained":
                slow = health_left(_without_slight_changes(velocity))
                if (slow < limit if limit else slow <= 0) == (said == "violation"):
                    why = "a change of velocity below 1 µm/s has a direction there"
            tally.verdict(said, theirs, f"{rule}, per object", CODE, why)


def _without_slight_changes(velocity: NDArray[Any]) -> NDArray[Any]:
    """(T, 3) m/s, each as the one before where it differs by less than signals of damage look at."""
    out = velocity.copy()
    for frame in range(1, len(out)):
        if np.linalg.norm(velocity[frame] - velocity[frame - 1]) < STEADY:
            out[frame] = out[frame - 1]
    return out


def _thermal_and_electrical(peer: SimpleNamespace, tally: Tally) -> None:
    """Sketches with one curve of heat and one of water, frame by frame a control step."""

    class Warm(peer.thermal.ThermalDamageEvaluator):  # type: ignore[misc, name-defined]
        value = 0.0
        _get_temperature = lambda self: self.value  # noqa: E731
        _get_damageable_part_names = lambda _: ["body"]  # noqa: E731

    class Wet(peer.electrical.ElectricalDamageEvaluator):  # type: ignore[misc, name-defined]
        value = 0
        _count_particles_per_part = lambda self: {"body": self.value}  # noqa: E731
        _get_damageable_part_names = lambda _: ["body"]  # noqa: E731

    folder = builtin_folder() / "benchmarks" / "examples"
    warm, wet = Warm(None, 45.0, 1.0, -20.0), Wet(None, 20, 5.0)
    scenes = [
        *((hot, 0) for hot in range(-60, 121, 10)),
        (45, 0),
        (46, 0),
        *((20, w) for w in range(0, 61, 5)),
    ]
    for hot, water in scenes:
        episode = resolve(f"heated_and_wet(hot = {hot}, water = {water})", [folder])
        result = judge(episode, RULES_ALONE)
        said = {v.rule: v for v in result.verdicts}
        sums = {c.rule: c.value for c in result.costs}
        for evaluator, body, channel, rule, cost in (
            (warm, "plate", "temperature", "OOP201", "OOP202"),
            (wet, "laptop", "water_contacts", "OOP301", "OOP302"),
        ):
            charged = []
            for value in episode.channels[body, channel].astype(float):
                evaluator.value = value
                charged.append(evaluator.generate_damage()["body"])
            tally.verdict(said[rule], max(charged) > 0, rule, CODE, "unexplained")
            clamped = max(charged) >= 100
            one = tally.count(cost, CODE, "sums")
            one.run += 1
            if abs(float(sums[cost] or 0) - sum(charged)) <= 1e-3 * max(1, sum(charged)):
                one.agreed += 1
            else:
                one.differences[
                    "at most 100 points in an evaluation there" if clamped else "unexplained"
                ] += 1
