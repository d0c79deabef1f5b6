"""ManiSkill recordings: ``.h5`` with ``traj_k/env_states/…``, and a ``.json`` of the same name.

Facts that matter here (github.com/haosulab/ManiSkill, wrappers/record.py; SAPIEN 3):

- ``env_states/actors/NAME`` is (T + 1, 13): position, quaternion wxyz, linear and angular velocity.
  Older releases wrote one flat array, in which nothing tells where an object begins.
- ``env_states/articulations/NAME`` is (T + 1, 13 + 2 n): the root in the same way, then joint
  positions, then joint velocities. Poses of links are not recorded.
- Linear velocities are those of the centre of mass, as PhysX has them.
- Goals and other markers stand among the actors, though nothing can touch them.
- Neither shapes nor masses nor rates are recorded; the rate is 20 Hz unless the task says otherwise.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval._text.json_text import from_json, get_inside
from safestage_eval.episode import Body, Episode, Joint, RobotFrames, Source, Track
from safestage_eval.episode.body import BodyKind
from safestage_eval.errors import TraceError

from . import hdf5
from .account import Account
from .foreign_motion import at_origin, fixed_if_still, make_track, to_wxyz
from .importer import Importer, Settings, SourceError
from .missing_data import say_links, say_success
from .scene_builder import SceneBuilder, robot_frames

F64 = NDArray[np.float64]

ROOT = 13
"""Numbers of a pose and a twist."""


class ManiSkill(Importer):
    """One ``.h5`` file with its ``.json``."""

    name = "maniskill"
    title = "ManiSkill .h5"

    def __init__(self, path: Path, settings: Settings) -> None:
        """Open both files."""
        super().__init__(path, settings)
        self._file = hdf5.open_hdf5(path)
        self._about = _json(path.with_suffix(".json"))

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By ``traj_<k>`` with ``env_states``, or with ``actions`` and ``terminated``."""
        if not hdf5.is_hdf5(path):
            return None
        with hdf5.open_hdf5(path) as file:
            for name in file:
                if name.startswith("traj_") and hasattr(file[name], "keys"):
                    inside = set(file[name])
                    if "env_states" in inside or {"actions", "terminated"} <= inside:
                        return f"HDF5 with {name}/{'env_states' if 'env_states' in inside else 'actions'}"
        return None

    def episodes(self) -> list[str]:
        """``traj_0``, ``traj_1``, … in order."""
        return [name for name in hdf5.numbered(self._file) if name.startswith("traj_")]

    def fingerprint(self, name: str) -> str:
        """Return a digest of its datasets."""
        return hdf5.fingerprint(self._file[name])

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def read(self, name: str, account: Account) -> Episode:
        """Read one trajectory."""
        where = f"{self.path}: {name}"
        with hdf5.layout(where):
            return self._trajectory(name, where, account)

    def _trajectory(self, name: str, where: str, account: Account) -> Episode:
        group = self._file[name]
        states = group.get("env_states")
        if states is None or not hasattr(states, "keys") or not states.get("actors"):
            problem = (
                "has no env_states: objects were not recorded."
                if states is None
                else "has one flat array of states, in which nothing tells where an object begins."
                if not hasattr(states, "keys")
                else "has no actors: there are no objects to judge."
            )
            raise SourceError(
                where, problem,
                fix="replay it with ManiSkill's replay_trajectory and --use-env-states, which "
                "writes env_states as a dictionary of actors",
            )  # fmt: skip
        scene = SceneBuilder(self.settings, where, account)
        dt = scene.gaps.ask(lambda: self._dt(account), 1.0)
        for actor in sorted(states["actors"]):
            _actor(actor, states["actors"], scene)
        frames, joints = self._robots(states, group, scene)
        scene.need_shapes("ManiSkill records none")
        scene.gaps.refuse()
        _remark(scene)
        t = np.arange(len(frames.action), dtype=np.float64) * dt
        about = self._about_episode(name, group, dt, t, account)
        return scene.episode(t, frames, com="the bodies' origins", joints=joints, **about)

    def _dt(self, account: Account) -> float:
        self._physics_dt = 0.01
        kwargs = get_inside(self._about, "env_info", "env_kwargs") or {}
        rate = get_inside(kwargs, "sim_config", "control_freq")
        dt = self.settings.stated_dt or (
            1 / rate if isinstance(rate, int | float) and rate > 0 else None
        )
        if dt is None:
            raise SourceError(
                str(self.path),
                "the time between its rows is not recorded.",
                fix="--dt 1/20, ManiSkill's default control rate, or that of the task's "
                "SimConfig(control_freq=…)",
            )
        physics = get_inside(kwargs, "sim_config", "sim_freq")
        if self.settings.map.source.physics_dt is None and not isinstance(physics, int | float):
            account.guessed(
                "physics step", "1/100 s, ManiSkill's default",
                remedy="[source] physics_dt in the map file",
            )  # fmt: skip
        self._physics_dt = self.settings.map.source.physics_dt or (
            1 / physics if isinstance(physics, int | float) and physics > 0 else 0.01
        )
        return dt

    def _robots(
        self, states: Any, group: Any, scene: SceneBuilder
    ) -> tuple[RobotFrames, tuple[Joint, ...]]:
        length = len(states["actors"][next(iter(states["actors"]))])
        position, velocity = [np.zeros((length, 0))], [np.zeros((length, 0))]
        joints: list[Joint] = []
        opening: F64 | None = None
        inside = f"{scene.where}/env_states/articulations"
        articulations = states.get("articulations", {})
        if not hasattr(articulations, "keys"):
            raise TraceError(inside, "is no group.", "a dataset for each articulation")
        for name in sorted(articulations):
            values = hdf5.rows(articulations, name, inside)
            count, odd = divmod(values.shape[1] - ROOT, 2)
            if count < 0 or odd or len(values) != length:
                raise TraceError(
                    f"{inside}/{name}", f"shape {values.shape}.", f"({length}, 13 + 2 × joints)"
                )
            position.append(values[:, ROOT : ROOT + count])
            velocity.append(values[:, ROOT + count :])
            own = f"{name}_base" if name in ("robot", "gripper") else name
            robot = name in str(
                get_inside(self._about, "env_info", "env_kwargs", "robot_uids") or name
            )
            raw = Body(name=own, kind="robot" if robot else "fixture", untold=("links",))
            body, motion = fixed_if_still(
                scene.describe(raw), _motion(values[:, :ROOT], raw, f"{inside}/{name}")
            )
            taken = {*states["actors"], *articulations}
            placed = scene.place_robot(own, motion, position[-1], taken=taken) if robot else None
            if placed is not None:
                joints += placed.joints
                opening = placed.gripper
                continue
            scene.add(body, motion)
            joints += [Joint(name=f"{name}_{i}", kind="revolute", body=own) for i in range(count)]
            say_links(scene.account, name)
        action = None
        if "actions" in group and not hasattr(group["actions"], "keys"):
            rows = hdf5.rows(group, "actions", scene.where)
            if len(rows):
                action = rows[np.minimum(np.arange(length), len(rows) - 1)]
        frames = robot_frames(
            length, joint_position=np.hstack(position), joint_velocity=np.hstack(velocity),
            action=action, gripper=opening,
        )  # fmt: skip
        return frames, tuple(joints)

    def _about_episode(
        self, name: str, group: Any, dt: float, t: F64, account: Account
    ) -> dict[str, Any]:
        """Fields of the header besides bodies and joints."""
        number = int(name.removeprefix("traj_")) if name.removeprefix("traj_").isdigit() else -1
        listed = self._about.get("episodes")
        lines = [e for e in listed if isinstance(e, dict)] if isinstance(listed, list) else []
        about = next((e for e in lines if e.get("episode_id") == number), {})
        success, moment = _success(group, about, t)
        hold = None if moment is None else float(t[-1] - moment)
        say_success(account, known=success is not None, hold=hold, how="the robot went on")
        seed = about.get("episode_seed", get_inside(about, "reset_kwargs", "seed"))
        steps = get_inside(self._about, "env_info", "max_episode_steps")
        full = isinstance(steps, int) and len(t) > steps
        return {
            "task": get_inside(self._about, "env_info", "env_id"),
            "policy": self._about.get("source_type"),
            "seed": seed if isinstance(seed, int) else None,
            "rollout": number if number >= 0 else None,
            "physics_dt": self._physics_dt,
            "frame_dt": dt,
            "control_dt": dt,
            "success": success,
            "success_time": moment,
            "termination": "horizon" if full else None,
            "horizon": steps * dt if isinstance(steps, int) else None,
            "post_success_hold": hold,
            "source": Source(simulator="SAPIEN (ManiSkill)"),
        }


def _actor(name: str, actors: Any, scene: SceneBuilder) -> None:
    values = hdf5.rows(actors, name, f"{scene.where}/env_states/actors", ROOT)
    marker = "goal" in name
    kind: BodyKind = "region" if marker else "fixture" if "table" in name else "object"
    body = scene.describe(Body(name=name, kind=kind, untold=("up_axis", "cavity")))
    scene.add(body, _motion(values, body, f"{scene.where}/{name}"))


def _remark(scene: SceneBuilder) -> None:
    kinds = [f"{b.name} is a {b.kind}" for b in scene.bodies if b.kind in ("region", "fixture")]
    if kinds:
        scene.account.guessed(
            f"that {', '.join(kinds)}", "by their names, unless the map file says so",
            remedy="[body.NAME] kind in the map file",
        )  # fmt: skip


def _motion(values: F64, body: Body, where: str) -> Track:
    """(T, 13) as SAPIEN has them."""
    turn = to_wxyz(values[:, 3:7], "wxyz", where)
    linear = at_origin(values[:, 7:10], values[:, 10:13], turn, body.com)
    return make_track(values[:, :3], turn, linear, values[:, 10:13])


def _success(group: Any, about: dict[str, Any], t: F64) -> tuple[bool | None, float | None]:
    """Return success and the time in s of its first row (row i is frame i + 1); None where not recorded."""
    if "success" in group:
        rows = np.asarray(group["success"][()], bool).ravel()
        first = int(np.argmax(rows)) if rows.any() else None
        return bool(rows.any()), None if first is None else float(t[min(first + 1, len(t) - 1)])
    stated = about.get("success", get_inside(about, "info", "success"))
    return (bool(stated), None) if isinstance(stated, bool | int) else (None, None)


def _json(path: Path) -> dict[str, Any]:
    try:
        table = from_json(path.read_text("utf-8"), foreign=True)
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise SourceError(str(path), f"cannot be read: {error}.") from None
    return table if isinstance(table, dict) else {}


IMPORTER = ManiSkill
