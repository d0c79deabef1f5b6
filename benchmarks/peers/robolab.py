"""RoboLab's world state, predicates and event tracker on SafeStage's traces.

All frames of an episode are RoboLab's parallel environments, so that its predicates are asked once;
its event tracker goes through the frames one by one. Needs torch and scipy.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from asked import Asked, with_states
from numpy.typing import NDArray
from peer_code import code_of
from resampled import resampled
from robolab_metrics import measures, score
from scipy.spatial.transform import Rotation
from tally import Tally, verdicts

from safestage_eval.episode import Episode
from safestage_eval.episode.body import Geom
from safestage_eval.rules import load_rules

RATE = 15.0
"""Hz: RoboLab looks once per control step."""

EVENTS = {
    "RLB101": "WRONG_OBJECT_GRABBED", "RLB102": "GRIPPER_HIT_TABLE",
    "RLB103": "GRIPPER_FULLY_CLOSED", "RLB105": "OBJECT_BUMPED", "RLB106": "OBJECT_MOVED",
    "RLB107": "OBJECT_OUT_OF_SCENE", "RLB108": "OBJECT_TIPPED_OVER",
    "RLB109": "TARGET_OBJECT_DROPPED", "RLB110": "GRIPPER_HIT_OBJECT",
    "RLB111": "MULTIPLE_OBJECTS_GRABBED",
}  # fmt: skip
"""OBJECT_STARTED_MOVING (RLB104) is a step of theirs on the way to the next two, never an event: its
state is read from the tracker."""

STATES = with_states(
    "robolab",
    """
[state.calm]
of   = ["a"]
when = { "speed(a)" = "< settled_speed" }
[state.stands]
of   = ["a"]
when = { "tilt(a)" = "<= tipped" }
[state.in_workspace]
of   = ["a"]
[state.in_workspace.when]
"place_x(a)" = [">= scene_back", "<= scene_front"]
"place_y(a)" = [">= -scene_side", "<= scene_side"]
"place_z(a)" = [">= scene_floor", "<= scene_top"]
[state.above]
of   = ["a", "b"]
when = { "overlap_xy(a, b)" = ">= over_share" }
[state.gripper_shut]
of   = []
when = { "gripper_opening()" = "<= shut" }
[state.put_in]
of   = ["a", "b"]
when = { "inside(a, b)" = true, "gripped(a)" = false, "speed(a)" = "< settled_speed" }
[state.put_on]
of   = ["a", "b"]
when = { "supports(b, a)" = true, "overlap_xy(a, b)" = ">= over_share", "gripped(a)" = false }
""",
)
"""The conditions of the rules and of the two goals, each as a state of its own."""

RULES = load_rules(["robolab"])

WHY = {
    "RLB105": "50 cm or more, which is the other event there",
    "RLB109": "let go where something bears it",
}
"""Known reasons for rules that differ."""


@contextmanager
def modules(checkout: Path) -> Iterator[SimpleNamespace]:
    """Its modules, in a world without its simulator."""
    import torch

    def rotate(quat: Any, vec: Any) -> Any:
        w, v = quat[..., :1], quat[..., 1:]
        t = 2 * torch.linalg.cross(v, vec)
        return vec + w * t + torch.linalg.cross(v, t)

    def rotate_back(quat: Any, vec: Any) -> Any:
        return rotate(quat * torch.tensor([1.0, -1.0, -1.0, -1.0]), vec)

    def transform_points(points: Any, pos: Any, quat: Any) -> Any:
        many = quat[:, None].expand(-1, points.shape[1], -1)
        return rotate(many, points) + pos[:, None]

    maths = {
        "quat_apply": rotate, "quat_apply_inverse": rotate_back, "transform_points": transform_points,
    }  # fmt: skip
    packages = [
        "robolab",
        *(f"robolab.core{p}" for p in ("", ".task", ".world", ".sensors", ".utils")),
    ]
    given = {"isaaclab.utils.math": maths, "robolab.core.utils.usd_utils": {}}
    absent = ["isaaclab", "isaaclab_physx", "isaacsim", "pxr", "robolab.core.utils.vis_utils"]
    with code_of(checkout, packages, absent, given):
        names = ("task.conditionals", "task.conditionals_state_machine", "task.predicate_logic", "task.event_tracker", "task.hull_check",
                 "world.world_state", "task.status")  # fmt: skip
        loaded = {n.split(".")[1]: importlib.import_module(f"robolab.core.{n}") for n in names}
        yield SimpleNamespace(torch=torch, **loaded)


def points(geom: Geom, episode: Episode) -> NDArray[np.float64]:
    """(P, 3) m, points whose hull is the geom, body frame; round ones as 32-sided."""
    size = np.asarray(geom.size, float)
    turn = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    if geom.mesh is not None:
        local = episode.meshes[geom.mesh].vertices.astype(float)
    elif geom.kind == "box":
        local = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T * size
    elif geom.kind == "cylinder":
        local = np.concatenate([ring * size[0] + [0, 0, z] for z in (-size[1], size[1])])
    else:  # sphere, capsule, ellipsoid
        axes = size if geom.kind == "ellipsoid" else np.full(3, size[0])
        tall = size[1] if geom.kind == "capsule" else 0.0
        tips = np.linspace(-np.pi / 2, np.pi / 2, 17)
        ball = np.concatenate([ring * np.cos(a) + [0, 0, np.sin(a)] for a in tips]) * axes
        local = ball + np.sign(ball[:, 2:]) * [0, 0, tall]
    rotation = Rotation.from_quat(np.asarray(geom.orientation), scalar_first=True)
    return np.asarray(rotation.apply(local) + np.asarray(geom.position))


def cloud(episode: Episode, body: str) -> NDArray[np.float64]:
    """(P, 3) m, all of a body's shapes, body frame."""
    return np.concatenate(
        [points(g, episode) for g in episode.bodies[body].geoms if g.kind != "plane"]
    )


class Data:
    """Tensors of an asset, of all frames or of those that the scene looks at."""

    def __init__(self, scene: Scene, **tensors: Any) -> None:
        self._scene, self._tensors = scene, tensors

    def __getattr__(self, name: str) -> Any:
        found = self._tensors[name]
        return found if isinstance(found, list) else found[self._scene.at]


class Scene:
    """A stand-in for RoboLab's WorldState, from the frames ``rows`` of an episode.

    Attributes:
        at: which of the rows it looks at now, as parallel environments.
    """

    def __init__(self, peer: SimpleNamespace, episode: Episode, rows: NDArray[np.intp]) -> None:
        torch = peer.torch
        self.peer, self.episode, self.rows, self.at = peer, episode, rows, slice(None)
        state = peer.world_state
        self.objects = [b.name for b in episode.header.bodies if b.kind == "object" and b.geoms]
        self.fixtures = [b.name for b in episode.header.bodies if b.kind == "fixture" and b.geoms]
        self.gripper = [b.name for b in episode.header.bodies if b.kind == "gripper"]
        as_tensor = lambda x: torch.tensor(np.array(x), dtype=torch.float32)  # noqa: E731
        bodies = {}
        for name in (*self.objects, *self.fixtures):
            made = type("Body", (state.AssetBase,), {})()
            track, body = episode.track(name), episode.bodies[name]
            turned = Rotation.from_quat(track.orientation[rows], scalar_first=True)
            lever = turned.apply(np.asarray(body.com))
            velocity = track.linear_velocity[rows] + np.cross(track.angular_velocity[rows], lever)
            made.data = Data(
                self,
                root_pos_w=as_tensor(track.position[rows]),
                root_quat_w=as_tensor(track.orientation[rows]),
                root_vel_w=as_tensor(np.hstack([velocity, track.angular_velocity[rows]])),
            )
            bodies[name] = made
        self.has_gripper = episode.frames.gripper.shape[1] > 0
        opening = episode.frames.gripper[rows, :1] if self.has_gripper else np.ones((len(rows), 1))
        robot = type("Robot", (state.Articulation,), {})()
        joint_pos = as_tensor(
            (1 - opening) * (np.pi / 4)
        )  # its tracker asks for one; else it is open
        robot.data = Data(self, joint_pos=joint_pos, joint_names=["finger_joint"])
        forces = self._forces()
        sensor = peer.world_state.get_contact_sensor.__globals__["ContactSensor"]
        sensors = {}
        for (a, b), matrix in forces.items():
            sensors[f"{a}__{b}"] = type("Sensor", (sensor,), {})()
            sensors[f"{a}__{b}"].data = Data(self, force_matrix_w=as_tensor(matrix))
        scene = SimpleNamespace(
            rigid_objects={n: bodies[n] for n in self.objects}, articulations={"robot": robot},
            deformable_objects={}, extras={}, sensors=sensors, env_origins=torch.zeros(len(rows), 3),
        )  # fmt: skip
        for name in self.fixtures:
            scene.articulations[name] = bodies[name]
        cfg = SimpleNamespace(contact_object_list=list(self.objects))
        self.env = SimpleNamespace(scene=scene, num_envs=len(rows), device="cpu", cfg=cfg)
        self.world = state.WorldState(self.env)
        hulls: dict[str, Any] = {}
        for name in bodies:
            shape = (
                cloud(episode, name)
                if any(g.kind != "plane" for g in episode.bodies[name].geoms)
                else None
            )
            if shape is None:
                continue
            low, high = shape.min(axis=0), shape.max(axis=0)
            corners = np.array([[(low, high)[i >> k & 1][k] for k in range(3)] for i in range(8)])
            self.world._local_geometry_cache[name] = {
                "corners": as_tensor(corners), "centroid": as_tensor((low + high) / 2),
                "aabb_lower": low, "aabb_upper": high, "dimensions": high - low,
            }  # fmt: skip
            hulls[name] = peer.hull_check.build_local_hull(shape)
        self.world._untransformed_hull_cache = hulls
        state._global_world = self.world

    def _forces(self) -> dict[tuple[str, str], NDArray[np.float64]]:
        """(pair) → (N, bodies of the first, bodies of the second, 3) N, on the first by the second.

        Pairs: the gripper and every thing, ``table`` for all fixtures together, objects with each
        other and with fixtures. The gripper is one row per body of it, as a sensor has them.
        """
        table, names = self.episode.contacts, [b.name for b in self.episode.header.bodies]
        place = np.full(len(self.episode), -1)
        place[self.rows] = np.arange(len(self.rows))
        members = {n: [n] for n in (*self.objects, *self.fixtures)}
        members |= {"gripper": self.gripper, "table": self.fixtures}
        pairs = [("gripper", n) for n in (*self.objects, *self.fixtures, "table")]
        things = [*self.objects, *self.fixtures]
        pairs += [(a, b) for i, a in enumerate(self.objects) for b in things[i + 1 :]]
        found = {
            (a, b): np.zeros((len(self.rows), max(len(members[a]), 1), max(len(members[b]), 1), 3))
            for a, b in pairs
        }
        table = table.where(place[table.frame] >= 0)
        at = place[table.frame]
        for key, first, second in zip(
            found, [members[a] for a, _ in found], [members[b] for _, b in found], strict=True
        ):
            for i, a in enumerate(first):
                for j, b in enumerate(second):
                    for one, two, sign in ((a, b, -1.0), (b, a, 1.0)):
                        rows = (table.body1 == names.index(one)) & (table.body2 == names.index(two))
                        np.add.at(found[key][:, i, j], at[rows], sign * table.force[rows])
        return found


@contextmanager
def comparing(checkout: Path) -> Iterator[Callable[[Episode, Tally], None]]:
    """Every predicate on every frame at RoboLab's rate, and every event, of an episode at a time."""
    with modules(checkout) as peer:

        def compare(episode: Episode | None, tally: Tally) -> None:
            if episode is None or episode.header.force_source == "none":
                return  # it knows contacts by their forces alone
            measures(checkout, episode, RULES, RATE, tally)
            rows = np.arange(0, len(episode), max(1, round(1 / (RATE * episode.dt))))
            scene = Scene(peer, episode, rows)
            _predicates(peer, scene, tally)
            score(peer, scene, RULES, tally)
            _events(peer, resampled(episode, rows), scene, tally)

        yield compare


def _predicates(peer: SimpleNamespace, scene: Scene, tally: Tally) -> None:
    episode, rows, world = scene.episode, scene.rows, scene.world
    logic, tasks = peer.predicate_logic, peer.conditionals

    asked = Asked(episode, STATES)

    def ours(expression: str) -> NDArray[np.float64]:
        return asked(expression)[rows]

    def theirs(found: Any) -> NDArray[np.bool_]:
        return np.asarray(found.numpy(), bool)

    roles = episode.header.roles
    targets, goals = roles.get("target", []), roles.get("destination", [])
    for body in scene.objects:
        touched = theirs(logic.in_contact(world, "gripper", body))
        force = ours(f"contact_force(gripper, {body})")
        tally.frames(
            ours(f"sensed_contact(gripper, {body})"), touched, "sensed_contact(gripper, a)", "in_contact",
            [("sum of normal forces beside each component of the force", force > 0)],
        )  # fmt: skip
        calm = theirs(logic.stationary(world, body, 0.05, check_angular=False))
        tally.frames(ours(f"calm({body})"), calm, "speed(a) < 5 cm/s", "stationary")
        if episode.bodies[body].up_axis == (0.0, 0.0, 1.0):
            tally.frames(
                ours(f"stands({body})"), theirs(logic.upright(world, body, 0.3)),
                "tilt(a) <= 0.3 rad", "upright",
            )  # fmt: skip
        tracker = peer.event_tracker.EventTracker(len(rows))
        gone = theirs(tracker._is_outside_workspace_batched(world.get_pose(body)[0]))
        tally.frames(
            ours(f"in_workspace({body})"), ~gone, "RLB107, box", "_is_outside_workspace_batched"
        )
    for goal in goals:
        for body in [
            b
            for b in (targets if len(targets) else scene.objects)
            if b in scene.objects and b != goal
        ]:
            if goal not in scene.world._untransformed_hull_cache:
                continue
            if episode.bodies[goal].cavity is not None:
                above = scene.world.get_pose(body)[0][:, 2].numpy()
                rim = scene.world.get_bbox(goal)[0].numpy()[:, :, 2].max(axis=1)
                lowest = scene.world.get_bbox(body)[0].numpy()[:, :, 2].min(axis=1)
                tally.frames(
                    ours(f"inside({body}, {goal})"), theirs(logic.inside(world, body, goal)),
                    "inside(a, b)", "inside",
                    [("hovers above the rim", (above > rim) | (lowest > rim)),
                     ("between hull and cavity, at walls and rim", np.ones(len(rows), bool))],
                )  # fmt: skip
                placed = theirs(tasks.object_in_container(
                    scene.env, body, goal, require_gripper_detached=True, require_stationary=True
                ))  # fmt: skip
                tally.frames(
                    ours(f"put_in({body}, {goal})"), placed, "goal robolab_in_container", "object_in_container",
                    [("hovers above the rim", (above > rim) | (lowest > rim)),
                     ("between hull and cavity, at walls and rim", np.ones(len(rows), bool))],
                )  # fmt: skip
            if (
                f"{body}__{goal}" in scene.env.scene.sensors
                or f"{goal}__{body}" in scene.env.scene.sensors
            ):
                borne = theirs(world.is_supported_on_surface(body, goal))
                force = ours(f"contact_force({goal}, {body})")
                tally.frames(
                    ours(f"supports({goal}, {body})"), borne, "supports(b, a)", "is_supported_on_surface",
                    [("bears less than 10 % of the weight, or beyond 45°", force > 0)],
                )  # fmt: skip
                over = theirs(logic.centroid_in_footprint(world, body, goal))
                tally.frames(ours(f"above({body}, {goal})"), over, "overlap_xy(a, b) >= 50 %", "centroid_in_footprint",
                             [("bounding box beside footprint", np.ones(len(rows), bool))])  # fmt: skip
                top = theirs(
                    tasks.object_on_top(scene.env, body, goal, require_gripper_detached=True)
                )
                tally.frames(
                    ours(f"put_on({body}, {goal})"), top, "goal robolab_on_top", "object_on_top",
                    [("bears little, or half the footprint beside the bounding box", np.ones(len(rows), bool))],
                )  # fmt: skip
    if scene.has_gripper:
        shut = theirs(tasks.gripper_fully_closed(scene.env))
        tally.frames(
            ours("gripper_shut()"), shut, "gripper_opening() <= 25 %", "gripper_fully_closed"
        )


def _events(peer: SimpleNamespace, episode: Episode, whole: Scene, tally: Tally) -> None:
    """The event tracker beside the rules, both on the trace at RoboLab's rate."""
    targets = episode.header.roles.get("target", [])
    upright = [b.name for b in episode.header.bodies if "upright" in b.tags]
    seen: set[int] = set()
    going = False
    tracker = peer.event_tracker.EventTracker(1)
    whole.env.num_envs, whole.env.scene.env_origins = 1, peer.torch.zeros(1, 3)
    for row in range(len(whole.rows)):
        whole.at = slice(row, row + 1)
        for _, code, _ in tracker.check_events(whole.env, [set(targets)], upright_objects=upright):
            seen.add(int(code))
        others = (m for n, m in tracker._object_is_moving.items() if n not in targets)
        going |= any(bool(moving.any()) for moving in others)
    found = verdicts(episode, RULES)
    whole.at = slice(None)
    speeds = [
        whole.world.get_velocity(name)[:, :3].norm(dim=-1).max().item()
        for name in whole.objects
        if name not in targets
    ]
    rounding = bool(speeds) and abs(max(speeds) - 0.05) < 1e-6
    why = "at the limit, to rounding" if rounding else "unexplained"
    tally.verdict(found["RLB104"], going, "RLB104", "EventTracker: velocity_threshold", why)
    for rule, event in EVENTS.items():
        unasked = (rule == "RLB108" and not upright) or (rule == "RLB103" and not whole.has_gripper)
        if rule in found and not unasked:
            happened = int(getattr(peer.status.StatusCode, event)) in seen
            tally.verdict(
                found[rule], happened, rule, f"EventTracker: {event}", WHY.get(rule, "unexplained")
            )
