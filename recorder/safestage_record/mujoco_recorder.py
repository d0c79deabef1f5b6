"""Records one rollout of a MuJoCo model and its data, whoever steps them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Callable, Mapping, Sequence

import numpy as np

from . import step_hook
from .body_facts import BodyFacts, Opening
from .contact_log import ContactLog, Copied
from .model_scene import ModelScene, body_names
from .rollout_recorder import FRAME_DT, RolloutRecorder
from .step_memory import StepMemory
from .told_facts import Names, ToldFacts


class MujocoRecorder(RolloutRecorder):
    """Records one rollout; as a context manager it writes the file at the end of the block.

    MuJoCo's step first computes poses, velocities, contacts and forces of the present state and
    then moves on. A frame holds what belongs to one moment: after a step, the one it started from.
    """

    simulator = "MuJoCo"

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

        names = body_names(model)
        told = ToldFacts(names, roles, kinds, fingers, up, tags)
        super().__init__(path, told, frame_dt, **header)
        self._mj, self._model, self._data = mujoco, model, data
        self.body_names = names
        facts = BodyFacts(model, names, told, mujoco)
        self._sides_guessed = facts.guessed
        self._scratch = mujoco.MjData(model)
        self._opening = Opening(model, self._scratch, facts, mujoco)
        self._scene = scene = ModelScene(model, names, facts, told.ups, told.tags, mujoco)
        told.roles = {
            role: [names[scene.whole.get(names.index(n), names.index(n))] for n in some]
            for role, some in told.roles.items()
        }
        self._roots = model.body_rootid[scene.movable]
        self._bodies, self._joints, self._meshes = scene.bodies, scene.joints, scene.meshes
        self._without_shape = scene.without_shape
        self._version_of_simulator = mujoco.__version__
        self._physics_dt = float(model.opt.timestep)
        self._gravity = tuple(model.opt.gravity)
        pyramidal = int(model.opt.cone) == int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
        memory = StepMemory(data, self._scratch)
        self._contact_log = ContactLog(model, memory, scene.geom_index, pyramidal)
        self._clock = memory.time
        self._runge_kutta = int(model.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4)
        self._views = (data.xpos, data.xquat, data.cvel, data.subtree_com, data.qfrc_actuator)
        self._coordinates = (data.qpos, data.qvel)
        self._seen = self._since = 0
        self._counted = False
        self._held: tuple[Any, ...] | None = None
        self._whole = False
        self._fresh, self._unsure = True, 8
        self._joint_state = self._read_joints()
        self._moment = self._started = self._latest = self._clock.value
        self._next = -np.inf
        if self._at_present() is not False and np.any(data.xquat[1:]):
            self._take_frame(self._look())
        if substeps:
            step_hook.watch(mujoco, data, self)

    @property
    def time(self) -> float:
        """s, time of the simulation."""
        return float(self._clock.value)

    def substep(self) -> None:
        """Look at the forces of a physics step; only where ``mujoco.mj_step`` is not what steps."""
        self._open()
        if not self._seen:
            self._counted = True
            self._contact_log.take()

    # ------------------------------------------------------------------ called at physics steps

    def take_steps(self, step: Callable[..., None], model: Any, data: Any, count: int) -> None:
        """Take physics steps; where none of them can be a frame, look at its contacts alone."""
        clock, take, every = self._clock, self._contact_log.take, self._frame_dt is None
        passed = 0
        for last in range(count - 1, -1, -1):
            if self._runge_kutta or (not last if every else clock.value > self._next):
                self.before_step()
                step(model, data)
                self.after_step()
            else:
                step(model, data)
                take()
                passed += 1
        self._seen += passed
        self._since += passed
        self._whole = self._whole or passed > 0

    def before_step(self) -> None:
        """A physics step begins: joints are now what its poses will be."""
        self._moment = moment = self._clock.value
        if moment > self._next or self._frame_dt is None:
            self._joint_state = self._read_joints()
            self._held = None

    def after_step(self) -> None:
        """A physics step has ended; contacts and forces are of the moment before it."""
        if self._runge_kutta:
            self._moment, self._joint_state = self._clock.value, self._read_joints()
        self._seen += 1
        self._since += 1
        self._whole = True
        if self._moment > self._next and self._frame_dt is not None:
            self._take_frame(self._look())
        else:
            self._contact_log.take()

    def before_contacts(self) -> None:
        """Contacts are about to be found anew without forces: keep those of the step before."""
        if self._whole and self._frame_dt is None:
            self._held, self._whole = (self._look(), self._contact_log.copy()), False

    def after_forward(self) -> None:
        """All of the data belongs to the present moment."""
        self._moment, self._joint_state = self._clock.value, self._read_joints()
        self._held, self._whole = None, True

    # ------------------------------------------------------------------ inside

    def _end_step(self) -> None:
        if not self._since:  # nobody told of steps: look whether poses are those of this moment
            present = self._at_present() if self._unsure else None
            if present is not None:
                self._fresh, self._unsure = present, self._unsure - 1
            late = not (self._fresh or self._runge_kutta)
            self._moment = self._clock.value - (self._physics_dt if late else 0.0)
            self._joint_state = self._read_joints()
        if self._frame_dt is None or not self._since:
            self._take_frame(*(self._held or (self._look(),)))
        self._since = 0

    def _watch_no_more(self) -> None:
        step_hook.unwatch(self._mj, self._data)

    def _sees(self) -> bool:
        return self._counted or self._seen > 0

    def _read_joints(self) -> tuple[Any, Any]:
        qpos, qvel = self._coordinates
        return qpos.tobytes(), qvel.tobytes()

    def _look(self) -> tuple[Any, ...]:
        """Copy what the data show, as bytes: moment, poses, velocities, joints."""
        xpos, xquat, cvel, com, torque = self._views
        return (
            self._moment,
            xpos.tobytes(),
            xquat.tobytes(),
            cvel.tobytes(),
            com.tobytes(),
            torque.tobytes(),
            self._joint_state,
        )

    def _take_frame(self, look: tuple[Any, ...], contacts: Copied | None = None) -> None:
        """Keep a frame, with the contacts that are now if they were not copied at its moment."""
        if self._keep(look[0], look[1:]):
            self._next = look[0] + (self._frame_dt or 0.0) - 0.5 * self._physics_dt
            self._contact_log.take_frame(contacts)

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
        return True if moving * self._physics_dt > 1e-9 else None

    def _contacts(self) -> tuple[Any, Any]:
        found = self._contact_log.finish()
        self._unrecorded = self._contact_log.unrecorded
        return found

    def _fixed(self) -> tuple[Any, Any]:
        return self._still

    def _columns(self, frames: list[Any]) -> dict[str, Any]:
        *columns, joints = zip(*frames)
        position, quat, cvel, com, torque = map(_stacked, columns, self._views)
        q, v = map(_stacked, zip(*joints), self._coordinates)
        moving, scene = self._scene.movable, self._scene
        if not self._log.begun:
            self._still = (position[0][scene.fixed], quat[0][scene.fixed])
        place, speed = position.take(moving, axis=1), _rounded(cvel, moving)
        # cvel is the velocity of the point of the body that is at the tree's centre of mass
        arm = (place - com.take(self._roots, axis=1)).astype(np.float32)
        return {
            "position": place,
            "orientation": _rounded(quat, moving),
            "linear_velocity": speed[..., 3:] + np.cross(speed[..., :3], arm),
            "angular_velocity": speed[..., :3],
            "joint_position": q[:, scene.joint_qpos],
            "joint_velocity": v[:, scene.joint_dof],
            "joint_torque": torque[:, scene.joint_dof],
            "gripper": self._opening.at(q),
        }


def _rounded(values: Any, bodies: Any) -> Any:
    """(T, M, …) float32 of some bodies; ``take`` is twice as fast as an index."""
    return values.take(bodies, axis=1).astype(np.float32)


def _stacked(copies: Sequence[bytes], view: Any) -> Any:
    """(T, …) of the bytes of an array at T frames."""
    return np.frombuffer(b"".join(copies)).reshape(len(copies), *view.shape)
