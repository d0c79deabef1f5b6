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

from safestage_eval._text.json_text import from_json
from safestage_eval.episode import Body, Episode, Header, Joint, RobotFrames, Source, Track
from safestage_eval.errors import TraceError

from . import hdf5
from .account import Account
from .foreign_motion import at_origin, fixed_if_still, make_track, to_wxyz
from .gaps import Gaps
from .importer import Importer, Settings, SourceError
from .missing_data import say_bodies, say_contacts, say_links, say_success
from .place_robot import place_robot
from .scene_bodies import apply_map, fixed_from_map, need_shapes

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
        gaps = Gaps(where, self.settings.noted)
        dt = gaps.ask(lambda: self._dt(account), 1.0)
        bodies: list[Body] = []
        tracks: dict[str, Track] = {}
        meshes: dict[str, Any] = {}
        for actor in sorted(states["actors"]):
            body, motion = self._actor(actor, states["actors"], where, meshes)
            bodies.append(body)
            tracks[body.name] = motion
        frames, joints = self._robots(states, group, where, bodies, tracks, account, meshes)
        gaps.ask(lambda: need_shapes(bodies, where, among="ManiSkill records none"), None)
        gaps.refuse()
        more, still = fixed_from_map(set(tracks), self.settings.map, meshes)
        self._remark(bodies, account)
        t = np.arange(len(frames.action), dtype=np.float64) * dt
        header = self._header(name, group, dt, t, (*bodies, *more), joints, account)
        return Episode(header, t, {**tracks, **still}, None, frames, meshes=meshes)

    def _dt(self, account: Account) -> float:
        self._physics_dt = 0.01
        kwargs = _inside(self._about, "env_info", "env_kwargs") or {}
        rate = _inside(kwargs, "sim_config", "control_freq")
        stated = self.settings.dt or self.settings.map.source.dt
        dt = stated or (1 / rate if isinstance(rate, int | float) and rate > 0 else None)
        if dt is None:
            raise SourceError(
                str(self.path),
                "the time between its rows is not recorded.",
                fix="--dt 1/20, ManiSkill's default control rate, or that of the task's "
                "SimConfig(control_freq=…)",
            )
        physics = _inside(kwargs, "sim_config", "sim_freq")
        if self.settings.map.source.physics_dt is None and not isinstance(physics, int | float):
            account.guessed(
                "physics step", "1/100 s, ManiSkill's default",
                remedy="[source] physics_dt in the map file",
            )  # fmt: skip
        self._physics_dt = self.settings.map.source.physics_dt or (
            1 / physics if isinstance(physics, int | float) and physics > 0 else 0.01
        )
        return dt

    def _actor(
        self, name: str, actors: Any, where: str, meshes: dict[str, Any]
    ) -> tuple[Body, Track]:
        values = hdf5.rows(actors, name, f"{where}/env_states/actors", ROOT)
        marker = "goal" in name
        raw = Body(
            name=name,
            kind="region" if marker else "fixture" if "table" in name else "object",
            untold=("up_axis", "cavity"),
        )
        body = apply_map(raw, self.settings.map, meshes)
        return fixed_if_still(body, _motion(values, body, f"{where}/{name}"))

    def _robots(
        self,
        states: Any,
        group: Any,
        where: str,
        bodies: list[Body],
        tracks: dict[str, Track],
        account: Account,
        meshes: dict[str, Any],
    ) -> tuple[RobotFrames, tuple[Joint, ...]]:
        length = len(states["actors"][next(iter(states["actors"]))])
        position, velocity = np.zeros((length, 0)), np.zeros((length, 0))
        joints: list[Joint] = []
        opening: F64 | None = None
        inside = f"{where}/env_states/articulations"
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
            own = f"{name}_base" if name in ("robot", "gripper") else name
            robot = name in str(
                _inside(self._about, "env_info", "env_kwargs", "robot_uids") or name
            )
            raw = Body(name=own, kind="robot" if robot else "fixture", untold=("links",))
            body, motion = fixed_if_still(
                apply_map(raw, self.settings.map, meshes),
                _motion(values[:, :ROOT], raw, f"{inside}/{name}"),
            )
            placed = None
            if robot:
                placed = place_robot(
                    self.settings, own, motion, values[:, ROOT : ROOT + count], account, meshes,
                    taken={*tracks, *states["actors"], *articulations},
                )  # fmt: skip
            if placed is not None:
                bodies += placed.bodies
                tracks.update(placed.tracks)
                joints += placed.joints
                opening = placed.gripper
                position = np.hstack([position, values[:, ROOT : ROOT + count]])
                velocity = np.hstack([velocity, values[:, ROOT + count :]])
                continue
            bodies.append(body)
            tracks[own] = motion
            position = np.hstack([position, values[:, ROOT : ROOT + count]])
            velocity = np.hstack([velocity, values[:, ROOT + count :]])
            joints += [Joint(name=f"{name}_{i}", kind="revolute", body=own) for i in range(count)]
            say_links(account, name)
        action = np.zeros((length, 0))
        if "actions" in group and not hasattr(group["actions"], "keys"):
            rows = hdf5.rows(group, "actions", where)
            if len(rows):
                action = rows[np.minimum(np.arange(length), len(rows) - 1)]
        none = np.zeros((length, 0), np.float32)
        columns = (position, velocity, none, action, none if opening is None else opening)
        return RobotFrames(*(c.astype(np.float32) for c in columns)), tuple(joints)

    def _header(
        self,
        name: str,
        group: Any,
        dt: float,
        t: F64,
        bodies: tuple[Body, ...],
        joints: tuple[Joint, ...],
        account: Account,
    ) -> Header:
        number = int(name.removeprefix("traj_")) if name.removeprefix("traj_").isdigit() else -1
        listed = self._about.get("episodes")
        lines = [e for e in listed if isinstance(e, dict)] if isinstance(listed, list) else []
        about = next((e for e in lines if e.get("episode_id") == number), {})
        success, moment = _success(group, about, t)
        hold = None if moment is None else float(t[-1] - moment)
        say_success(account, known=success is not None, hold=hold, how="the robot went on")
        seed = about.get("episode_seed", _inside(about, "reset_kwargs", "seed"))
        steps = _inside(self._about, "env_info", "max_episode_steps")
        full = isinstance(steps, int) and len(t) > steps
        return Header(
            episode_id="",
            task=_inside(self._about, "env_info", "env_id"),
            policy=self._about.get("source_type"),
            seed=seed if isinstance(seed, int) else None,
            rollout=number if number >= 0 else None,
            physics_dt=self._physics_dt,
            frame_dt=dt,
            control_dt=dt,
            success=success,
            success_time=moment,
            termination="horizon" if full else None,
            horizon=steps * dt if isinstance(steps, int) else None,
            post_success_hold=hold,
            force_source="none",
            source=Source(simulator="SAPIEN (ManiSkill)"),
            bodies=bodies,
            joints=joints,
        )

    def _remark(self, bodies: list[Body], account: Account) -> None:
        say_bodies(account, bodies, self.settings.map, "the bodies' origins")
        say_contacts(account)
        kinds = [f"{b.name} is a {b.kind}" for b in bodies if b.kind in ("region", "fixture")]
        if kinds:
            account.guessed(
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
    stated = about.get("success", _inside(about, "info", "success"))
    return (bool(stated), None) if isinstance(stated, bool | int) else (None, None)


def _json(path: Path) -> dict[str, Any]:
    try:
        table = from_json(path.read_text("utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise SourceError(str(path), f"cannot be read: {error}.") from None
    return table if isinstance(table, dict) else {}


def _inside(table: Any, *keys: str) -> Any:
    for key in keys:
        table = table.get(key) if isinstance(table, dict) else None
    return table


IMPORTER = ManiSkill
