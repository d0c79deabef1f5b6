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

from safestage_eval._text.json_text import get_inside
from safestage_eval.episode import Body, Episode, Source, Track
from safestage_eval.episode.body import BodyKind
from safestage_eval.errors import TraceError

from . import hdf5
from .account import Account
from .foreign_motion import at_origin, make_track, to_wxyz
from .importer import Importer, Settings, SourceError, json_table
from .missing_data import say_success
from .scene_builder import SceneBuilder

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
        self._about = json_table(path.with_suffix(".json"), whole=True)

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
        dt = scene.ask(self._dt, 1.0)
        for actor in sorted(states["actors"]):
            _actor(actor, states["actors"], scene)
        length = len(states["actors"][next(iter(states["actors"]))])
        self._articulations(states, length, scene)
        if "actions" in group and not hasattr(group["actions"], "keys"):
            rows = hdf5.rows(group, "actions", where)
            scene.record(action=rows[np.minimum(np.arange(length), len(rows) - 1)])
        scene.need_shapes("ManiSkill records none")
        scene.refuse()
        _remark(scene)
        t = np.arange(length, dtype=np.float64) * dt
        about = self._about_episode(name, group, dt, t, account)
        return scene.episode(t, com="the bodies' origins", **about)

    def _rate(self, key: str) -> float | None:
        """S for one of a frequency in the environment's ``sim_config``."""
        rate = get_inside(self._about, "env_info", "env_kwargs", "sim_config", key)
        return 1 / rate if isinstance(rate, int | float) and rate > 0 else None

    def _dt(self) -> float:
        dt = self.settings.stated_dt or self._rate("control_freq")
        if dt is None:
            raise SourceError(
                str(self.path),
                "the time between its rows is not recorded.",
                fix="--dt 1/20, ManiSkill's default control rate, or that of the task's "
                "SimConfig(control_freq=…)",
            )
        return dt

    def _articulations(self, states: Any, length: int, scene: SceneBuilder) -> None:
        inside = f"{scene.where}/env_states/articulations"
        articulations = states.get("articulations", {})
        if not hasattr(articulations, "keys"):
            raise TraceError(inside, "is no group.", "a dataset for each articulation")
        robots = get_inside(self._about, "env_info", "env_kwargs", "robot_uids")
        for name in sorted(articulations):
            values = hdf5.rows(articulations, name, inside)
            count, odd = divmod(values.shape[1] - ROOT, 2)
            if count < 0 or odd or len(values) != length:
                raise TraceError(
                    f"{inside}/{name}", f"shape {values.shape}.", f"({length}, 13 + 2 × joints)"
                )
            motion = _motion(values[:, :ROOT], (0.0, 0.0, 0.0), f"{inside}/{name}")
            position, velocity = np.split(values[:, ROOT:], 2, axis=1)
            robot, taken = name in str(robots or name), {*states["actors"], *articulations}
            scene.articulation(name, motion, position, velocity, robot=robot, taken=taken)

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
        physics = self.settings.map.source.physics_dt or self._rate("sim_freq")
        if physics is None:
            account.guessed(
                "physics step", "1/100 s, ManiSkill's default",
                remedy="[source] physics_dt in the map file",
            )  # fmt: skip
        seed = about.get("episode_seed", get_inside(about, "reset_kwargs", "seed"))
        steps = get_inside(self._about, "env_info", "max_episode_steps")
        full = isinstance(steps, int) and len(t) > steps
        return {
            "task": get_inside(self._about, "env_info", "env_id"),
            "policy": self._about.get("source_type"),
            "seed": seed if isinstance(seed, int) else None,
            "rollout": number if number >= 0 else None,
            "physics_dt": physics or 0.01,
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
    scene.add(body, _motion(values, body.com, f"{scene.where}/{name}"))


def _remark(scene: SceneBuilder) -> None:
    kinds = [f"{b.name} is a {b.kind}" for b in scene.bodies if b.kind in ("region", "fixture")]
    if kinds:
        scene.account.guessed(
            f"that {', '.join(kinds)}", "by their names, unless the map file says so",
            remedy="[body.NAME] kind in the map file",
        )  # fmt: skip


def _motion(values: F64, com: tuple[float, float, float], where: str) -> Track:
    """The track of (T, 13) as SAPIEN has them; ``com``: m, in the body frame."""
    turn = to_wxyz(values[:, 3:7], "wxyz", where)
    linear = at_origin(values[:, 7:10], values[:, 10:13], turn, com)
    return make_track(values[:, :3], turn, linear, values[:, 10:13])


def _success(group: Any, about: dict[str, Any], t: F64) -> tuple[bool | None, float | None]:
    """Return success and the time in s of its first row (row i is frame i + 1); None where not recorded."""
    if "success" in group:
        rows = np.asarray(group["success"][()], bool).ravel()
        first = int(np.argmax(rows)) if rows.any() else None
        return bool(rows.any()), None if first is None else float(t[min(first + 1, len(t) - 1)])
    stated = about.get("success", get_inside(about, "info", "success"))
    return (bool(stated), None) if isinstance(stated, bool | int) else (None, None)


IMPORTER = ManiSkill
