"""Records one rollout of a MuJoCo model and its data, whoever steps them."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any, Mapping, Sequence, Union

import numpy as np

from . import step_hook
from ._version import __version__
from .body_facts import BodyFacts, Opening, find_bodies
from .contact_log import ContactLog, copy_contacts
from .model_scene import ModelScene, body_names
from .record_error import RecordError
from .scene_report import guess_ups, remarks, report
from .zip_trace import write_zip

Names = Union[str, Sequence[str]]

FRAME_DT = 0.01
"""s between frames. Control steps of 0.05 s are too far apart to tell how something moved or fell."""


class MujocoRecorder:
    """Records one rollout; as a context manager it writes the file at the end of the block.

    MuJoCo's step first computes poses, velocities, contacts and forces of the present state and
    then moves on. A frame holds what belongs to one moment: after a step, the one it started from.

    Attributes:
        body_names: all bodies, as the trace names them.
        path: the file that ``close`` writes.
    """

    def __init__(
        self,
        model: Any,
        data: Any,
        path: str | Path,
        *,
        roles: Mapping[str, Names] | None = None,
        kinds: Mapping[str, str] | None = None,
        fingers: Mapping[str, str] | None = None,
        up: str | Mapping[str, Sequence[float]] | None = None,
        tags: Mapping[str, Sequence[str]] | None = None,
        frame_dt: float | None = FRAME_DT,
        substeps: bool = True,
        **header: Any,
    ) -> None:
        """Begin to record; nothing in model or data is changed.

        Args:
            model: ``mujoco.MjModel``, compiled.
            data: ``mujoco.MjData`` of the simulation that is stepped.
            path: a file ending in ``.zip``.
            roles: role of the safety rules → name or names of bodies.
            kinds: body name → robot, gripper, object, fixture or region, where guessed wrong; it
                holds for what hangs on the body, too.
            fingers: body name → left or right, where guessed wrong.
            up: body name → unit vector (3,) of the body frame that points up when it stands as
                intended; ``"guess"``: of each object the axis that does at the first frame.
            tags: body name → words that rules ask for (fragile, liquid, sharp, …).
            frame_dt: s between frames, to the next physics step; None: one frame per ``step``, as
                always where physics steps are not seen.
            substeps: look at every physics step, so that forces between two frames are known.
            header: further fields of the trace's header: episode_id, task, stage, instruction,
                policy, seed, rollout, goal, rules, parameters, horizon, ….

        Raises:
            RecordError: another ending, or a name that is no body of the model.
        """
        import mujoco

        self.path = Path(path)
        if self.path.suffix.lower() != ".zip":
            raise RecordError(
                f"{path}: recordings are ZIP files. Allowed: a name ending in .zip. "
                "safestage convert makes MCAP and Parquet of them."
            )
        self._mj, self._model, self._data = mujoco, model, data
        self.body_names = names = body_names(model)
        self._roles: dict[str, list[str]] = {}
        for role, given in (roles or {}).items():
            some = [given] if isinstance(given, str) else list(given)
            self._roles[role] = [
                names[find_bodies(n, names, f"role {role!r}: the body")] for n in some
            ]
        self._facts = BodyFacts(model, names, kinds or {}, fingers or {}, mujoco)
        self._scratch = mujoco.MjData(model)
        self._opening = Opening(model, self._scratch, self._facts, mujoco)
        self._guess_up = up == "guess"
        ups = {} if up is None or isinstance(up, str) else up
        self._ups = {
            find_bodies(name, names, "the body of the up axis,"): _unit(axis, name)
            for name, axis in ups.items()
        }
        marked = {find_bodies(n, names, "the tagged body"): t for n, t in (tags or {}).items()}
        self._scene = ModelScene(model, names, self._facts, self._ups, marked, mujoco)
        pyramidal = int(model.opt.cone) == int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
        self._log = ContactLog(model, self._scene.geom_index, pyramidal)
        self._runge_kutta = int(model.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4)
        self._frame_dt = frame_dt
        self._header = dict(header)
        self._frames: list[tuple[Any, ...]] = []
        self._actions: list[Any] = []
        self._action: Any = None
        self._steps: list[float] = []
        self._success: bool | None = None
        self._success_time: float | None = None
        self._seen = self._since = 0
        self._counted = False
        self._held: tuple[Any, ...] | None = None
        self._whole = False
        self._closed = False
        self._fresh, self._unsure = True, 8
        self._joints = self._read_joints()
        self._moment = float(data.time)
        self._next = -np.inf
        self._started = float(data.time)
        if self._at_present() is not False and np.any(data.xquat[1:]):
            self._keep(self._look())
        if substeps:
            step_hook.watch(mujoco, data, self)

    # ------------------------------------------------------------------ what the user calls

    def step(self, action: Any = None) -> None:
        """End a control step: call it after each, with the action that it carried out.

        Args:
            action: (A,) the command; always of one length, or never given.

        Raises:
            RecordError: the recording is closed, or the simulation's time went back.
        """
        self._open()
        data = self._data
        latest = max([self._started, *self._steps[-1:]])
        if data.time < latest:
            raise RecordError(
                f"{self.path}: the simulation went back from {latest:.6g} s to "
                f"{data.time:.6g} s. Close this recording before a reset and begin another."
            )
        if action is not None:
            self._action = np.array(action, np.float32).ravel()
        if not self._since:  # nobody told of steps: look whether poses are those of this moment
            present = self._at_present() if self._unsure else None
            if present is not None:
                self._fresh, self._unsure = present, self._unsure - 1
            late = not (self._fresh or self._runge_kutta)
            self._moment = float(data.time) - (float(self._model.opt.timestep) if late else 0.0)
            self._joints = self._read_joints()
        if self._frame_dt is None or not self._since:
            self._keep(self._look() if self._held is None else self._held)
        for i in range(len(self._actions) - 1, -1, -1):
            if self._actions[i] is not None:
                break
            self._actions[i] = self._action
        self._steps.append(float(data.time))
        self._since = 0

    def substep(self) -> None:
        """Look at the forces of a physics step; only where ``mujoco.mj_step`` is not what steps."""
        self._open()
        if not self._seen:
            self._counted = True
            self._log.take(self._data)

    def success(self, reached: bool | None = True) -> None:
        """Say whether the task's goal is reached; the last frame is the time of the first success."""
        if reached is None:
            return
        if reached and not self._success and self._frames:
            self._success_time = self._frames[-1][0] - self._frames[0][0]
        self._success = bool(reached) or bool(self._success)

    def header(self, **fields: Any) -> None:
        """Set further fields of the header (``termination``, ``post_success_hold``, …)."""
        self._header.update(fields)

    def report(self) -> str:
        """What was recorded, guessed and is missing, in lines; what to pass where a guess is wrong."""
        sees = self._sees() if self._sees() or self._steps else None
        lines = report(self._scene, self._facts, self._ups, self._proposed(), sees, self._roles)
        return "\n".join(lines)

    @property
    def succeeded(self) -> bool:
        """Whether the goal was reached so far."""
        return bool(self._success)

    @property
    def stepped(self) -> int:
        """Control steps so far."""
        return len(self._steps)

    @property
    def time(self) -> float:
        """s, time of the simulation."""
        return float(self._data.time)

    def __len__(self) -> int:
        """Frames so far."""
        return len(self._frames)

    def close(self) -> Path:
        """Write the file, whole or not at all, and return its path.

        Raises:
            RecordError: no frame was recorded, or the file cannot be written.
        """
        self.stop()
        if not self._frames:
            raise RecordError(f"{self.path}: no frame was recorded. Call step() after each action.")
        if self._guess_up:
            for i, axis in self._proposed().items():
                if i not in self._ups:
                    self._ups[i] = axis
                    body = self._scene.bodies[self._scene.ids.index(i)]
                    body["up_axis"] = axis
                    body["untold"] = [name for name in body["untold"] if name != "up_axis"]
        points, counts = self._log.finish()
        write_zip(self.path, self._about(), dict(self._columns(), contacts=points, counts=counts))
        return self.path

    def stop(self) -> None:
        """Record no further, and write nothing."""
        self._closed = True
        step_hook.unwatch(self._mj, self._data)

    def __enter__(self) -> MujocoRecorder:  # noqa: PYI034
        """The recorder itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Write the file; none after an exception."""
        if kind is not None:
            self.stop()
        elif not self._closed:
            self.close()

    # ------------------------------------------------------------------ called at physics steps

    def before_step(self) -> None:
        """A physics step begins: joints are now what its poses will be."""
        self._moment = self._data.time
        if self._frame_dt is None or self._moment > self._next:
            self._joints = self._read_joints()
            self._held = None

    def after_step(self) -> None:
        """A physics step has ended; contacts and forces are of the moment before it."""
        data = self._data
        if self._runge_kutta:
            self._moment, self._joints = float(data.time), self._read_joints()
        self._seen += 1
        self._since += 1
        self._whole = True
        if self._frame_dt is not None and self._moment > self._next:
            self._keep(self._look())
        elif data.ncon:
            self._log.take(data)

    def before_contacts(self) -> None:
        """Contacts are about to be found anew without forces: keep those of the step before."""
        if self._whole and self._frame_dt is None:
            self._held, self._whole = self._look(), False

    def after_forward(self) -> None:
        """All of the data belongs to the present moment."""
        self._moment, self._joints = float(self._data.time), self._read_joints()
        self._held, self._whole = None, True

    # ------------------------------------------------------------------ inside

    def _open(self) -> None:
        if self._closed:
            raise RecordError(f"{self.path}: the recording is closed. Begin another one.")

    def _sees(self) -> bool:
        return self._counted or self._seen > 0

    def _read_joints(self) -> tuple[Any, Any]:
        return self._data.qpos.copy(), self._data.qvel.copy()

    def _look(self) -> tuple[Any, ...]:
        """Copy what the data show: moment, poses, velocities, joints, contacts."""
        data = self._data
        return (
            self._moment,
            data.xpos.copy(),
            data.xquat.copy(),
            data.cvel.copy(),
            data.subtree_com.copy(),
            self._joints,
            data.qfrc_actuator.copy(),
            copy_contacts(data),
        )

    def _keep(self, look: tuple[Any, ...]) -> None:
        """Append a frame; one of the same moment as the last is none."""
        if self._frames and look[0] <= self._frames[-1][0] + 1e-9:
            return
        if not self._frames:
            fixed = self._scene.fixed
            self._fixed = (look[1][fixed], look[2][fixed])
        self._next = look[0] + (self._frame_dt or 0.0) - 0.5 * float(self._model.opt.timestep)
        self._frames.append(look[:-1])
        self._actions.append(None)
        self._log.take_frame(look[-1])

    def _at_present(self) -> bool | None:
        """Whether poses are those of the present coordinates; None where nothing moves."""
        data, scratch = self._data, self._scratch
        scratch.qpos[:] = data.qpos
        if self._model.nmocap:
            scratch.mocap_pos[:], scratch.mocap_quat[:] = data.mocap_pos, data.mocap_quat
        self._mj.mj_kinematics(self._model, scratch)
        if np.abs(scratch.xpos - data.xpos).max() > 1e-12:
            return False
        moving = np.abs(data.qvel).max() if self._model.nv else 0.0
        return True if moving * float(self._model.opt.timestep) > 1e-9 else None

    def _proposed(self) -> dict[int, list[float]]:
        """Body id → axis that points up at the first frame."""
        if not self._frames:
            return {}
        return guess_ups(self._scene, self._frames[0][2])

    def _columns(self) -> dict[str, Any]:
        """Every array of the file but contacts; T frames, M moving bodies, F fixed ones."""
        t, position, quat, cvel, com, joints, torque = zip(*self._frames)
        times = np.array(t, np.float64)
        moving, scene = self._scene.movable, self._scene
        place, speed = np.array(position)[:, moving], np.array(cvel)[:, moving]
        # cvel is the velocity of the point of the body that is at the tree's centre of mass
        arm = place - np.array(com)[:, self._model.body_rootid[moving]]
        linear = speed[..., 3:] + np.cross(speed[..., :3], arm)
        action = np.zeros((len(t), 0))
        if self._action is not None:
            action = np.array([self._action if a is None else a for a in self._actions])
        q, v = (np.array(values) for values in zip(*joints))
        columns = {
            "position": place.swapaxes(0, 1),
            "orientation": np.array(quat)[:, moving].swapaxes(0, 1),
            "linear_velocity": linear.swapaxes(0, 1),
            "angular_velocity": speed[..., :3].swapaxes(0, 1),
            "fixed_position": self._fixed[0],
            "fixed_orientation": self._fixed[1],
            "joint_position": q[:, scene.joint_qpos],
            "joint_velocity": v[:, scene.joint_dof],
            "joint_torque": np.array(torque)[:, scene.joint_dof],
            "action": action,
            "gripper": self._opening.at(q),
        }
        arrays = {name: values.astype("<f4") for name, values in columns.items()}
        arrays["t"] = times - times[0]
        for key, (vertices, faces) in self._scene.meshes.items():
            arrays[f"mesh/{key}.vertices"], arrays[f"mesh/{key}.faces"] = vertices, faces
        return arrays

    def _about(self) -> dict[str, Any]:
        step = float(self._model.opt.timestep)
        control = _usual_gap([self._started, *self._steps], step)
        frame = control
        if self._frame_dt is not None and self._sees() and len(self._frames) > 1:
            frame = _usual_gap([look[0] for look in self._frames], step)
        success = self._success
        header = {
            "schema_version": "1.2",
            "episode_id": self.path.stem,
            "physics_dt": step,
            "frame_dt": frame,
            "control_dt": control,
            "gravity": [float(g) for g in self._model.opt.gravity],
            "success": success,
            "success_time": self._success_time,
            "termination": "success" if success else None,
            "roles": self._roles,
            "force_source": "recorded",
            "source": {
                "simulator": "MuJoCo",
                "simulator_version": self._mj.__version__,
                "recorder": "safestage-record",
                "recorder_version": __version__,
                "account": remarks(
                    self._facts, self._ups if self._guess_up else {},
                    self._sees(), self._log.unrecorded,
                ),
            },
        }  # fmt: skip
        header.update(self._header, bodies=self._scene.bodies, joints=self._scene.joints)
        return {"frames": len(self._frames), "header": header}


def _usual_gap(times: list[float], step: float) -> float:
    """The median gap (s) between times, in whole physics steps; one step where there is none."""
    gaps = np.sort(np.diff(times))
    return max(1, round(float(gaps[len(gaps) // 2]) / step)) * step if len(gaps) else step


def _unit(axis: Sequence[float], name: str) -> list[float]:
    values = np.array(axis, float)
    if values.shape != (3,) or not np.linalg.norm(values) > 0:
        raise RecordError(
            f"the up axis of {name!r} is {axis!r}. Allowed: three numbers, not all 0."
        )
    return [float(v) for v in values / np.linalg.norm(values)]
