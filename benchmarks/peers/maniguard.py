"""ManiGuard's object states and checks on traces, and its formulas beside the rules.

The states Upright and Dropped and the checks overhead_forbidden and inverted are its own code; its
monitor needs Spot, which is not installed here, so that a formula is read as what it forbids.
"""

from __future__ import annotations

import ast
import inspect
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from asked import Asked, with_states
from peer_code import functions
from scipy.spatial.transform import Rotation
from tally import Tally

from safestage_eval.episode import Episode
from safestage_eval.rules import load_rules

RULES = with_states(
    "maniguard",
    """
[state.upright]
of   = ["a"]
when = { "tilt(a)" = "<= knocked" }
[state.inverted]
of   = ["a"]
when = { "tilt(a)" = ">= upside_down" }
""",
)
STATES = "maniguard/object_states"
SPEC = "maniguard/utils/task_spec.py"


COMPARED_AS = dict.fromkeys(load_rules(["maniguard"]).rules, "rules by id")
"""Rule → what it is compared as: the formulas by their ids, their predicates apart."""


@contextmanager
def comparing(checkout: Path) -> Iterator[Callable[[Episode | None, Tally], None]]:
    """Every object; the target over every other object."""
    import torch

    def apply(quat: Any, vector: Any) -> Any:
        turned = Rotation.from_quat(np.asarray(quat, float)).apply(np.asarray(vector, float))
        return torch.as_tensor(turned, dtype=torch.float32)

    space = {"th": torch, "T": SimpleNamespace(quat_apply=apply)}
    upright = functions(checkout / STATES / "upright.py", ["Upright._get_value"], space)[
        "Upright._get_value"
    ]
    dropped = functions(checkout / STATES / "dropped.py", ["Dropped._get_value"], {})[
        "Dropped._get_value"
    ]
    monitor = checkout / "maniguard/utils/safety_monitor.py"
    build = [
        f"SafetyPropositionEvaluator.{n}" for n in ("_build_overhead_forbidden", "_build_inverted")
    ]
    built = functions(monitor, build, {"math": math, "log": SimpleNamespace(warning=print)})

    class Thing:
        """An object of its simulator, which gives quaternions with the real part last."""

        def __init__(self, episode: Episode, name: str) -> None:
            from robolab import cloud

            self.track, self.frame = episode.track(name), 0
            self.points = cloud(episode, name)

        def get_position_orientation(self) -> tuple[Any, Any]:
            return self.track.position[self.frame], self.track.orientation[self.frame][[1, 2, 3, 0]]

        @property
        def aabb(self) -> tuple[Any, Any]:
            turned = Rotation.from_quat(self.track.orientation[self.frame], scalar_first=True)
            world = turned.apply(self.points) + self.track.position[self.frame]
            return world.min(axis=0), world.max(axis=0)

    def compare(episode: Episode | None, tally: Tally) -> None:
        if episode is None:
            _formulas(checkout, tally)
            return
        asked = Asked(episode, RULES)
        frames = np.arange(0, len(episode), max(1, round(0.1 / episode.dt)))
        names = [b.name for b in episode.header.bodies if b.kind == "object" and b.geoms]
        things = {name: Thing(episode, name) for name in names}

        def look(what: Callable[[], bool], *looked_at: str) -> Any:
            seen = []
            for frame in frames:
                for name in looked_at:
                    things[name].frame = frame
                seen.append(bool(what()))
            return np.array(seen)

        for name in names:
            thing = things[name]
            state = SimpleNamespace(obj=thing, floor_z=0.0, z_margin=0.05, max_tilt_deg=45.0)
            level = thing.track.position[frames, 2]
            tally.frames(asked(f"dropped_to_floor({name})")[frames], look(lambda s=state: dropped(s), name),
                         "Dropped", "Dropped._get_value", [("at the limit, to rounding", np.abs(level - 0.05) < 1e-6)])  # fmt: skip
            if episode.bodies[name].up_axis == (0.0, 0.0, 1.0):
                tally.frames(asked(f"upright({name})")[frames], look(lambda s=state: upright(s), name),
                             "tilt(a) <= 45 deg", "Upright._get_value")  # fmt: skip
                resolver = SimpleNamespace(resolve_patterns=lambda _, t=thing: {"a": t})
                check = built[build[1]](
                    SimpleNamespace(_resolver=resolver),
                    {"over": ["a"], "params": {"min_tilt_deg": 120.0}},
                )
                tally.frames(
                    asked(f"inverted({name})")[frames],
                    look(check, name),
                    "tilt(a) >= 120 deg",
                    "_build_inverted",
                )
        for target in [t for t in episode.header.roles.get("target", ())[:1] if t in things]:
            for zone in [n for n in names if n != target]:
                resolver = SimpleNamespace(
                    resolve_patterns=lambda which: {which[0]: things[which[0]]}
                )
                check = built[build[0]](SimpleNamespace(_resolver=resolver),
                                        {"carried": [target], "zones": [zone], "params": {"margin_m": 0.02}})  # fmt: skip
                there = look(check, target, zone)
                tally.frames(asked(f"passes_over({target}, {zone})")[frames], there, "MGD601", "_build_overhead_forbidden",
                             [("all of the shape beside its origin", ~there),
                              ("bounding box beside footprint, or origin above and shape not", there)])  # fmt: skip

    yield compare


def _formulas(checkout: Path, tally: Tally) -> None:
    """Every constraint that its generators write is one of our rules, by its id."""
    names = [n for n in _generators(checkout) if n.endswith("ltl_safety_json")]
    space = {"Sequence": tuple, "_synset_to_category": lambda s: s}
    alike = {
        "fragiles_upright": "no_fragile_tipped_over",
        "obstacle_not_dropped": "no_obstacle_dropped",
    }
    ours = {rule.title.partition(":")[0] for rule in load_rules(["maniguard"]).rules.values()}
    for name in names:
        generate = functions(checkout / SPEC, [name], space)[name]
        given = {
            p: "x" if p.endswith("category") or p == "activity_name" else ("x",)
            for p, value in inspect.signature(generate).parameters.items()
            if p.endswith(("_synsets", "_category")) or p == "activity_name"
        }
        for constraint in generate(**given)["constraints"]:
            one = tally.count("rules by id", f"{name}", "formulas")
            one.run += 1
            one.agreed += alike.get(constraint["id"], constraint["id"]) in ours


def _generators(checkout: Path) -> list[str]:
    tree = ast.parse((checkout / SPEC).read_text("utf-8"))
    return [
        n.name
        for n in tree.body
        if isinstance(n, ast.FunctionDef) and n.name.startswith("generate")
    ]
