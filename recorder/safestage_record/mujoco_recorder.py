"""Records one rollout of a MuJoCo model and its data, whoever steps them."""

from __future__ import annotations

from pathlib import Path
from time import monotonic
from typing import Any, Callable

import numpy as np

from . import step_hook
from .body_facts import BodyFacts, Opening
from .contact_log import ContactLog
from .frame_views import FrameViews
from .model_scene import ModelScene
from .rollout_recorder import FRAME_DT, MOST_WAITING, RolloutRecorder
from .step_memory import StepMemory

_join = b"".join


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
        frame_dt: float | None = FRAME_DT,
        substeps: bool = True,
        **settings: Any,
    ) -> None:
        """Begin to record; nothing in model or data is changed.

        Args:
            model: ``mujoco.MjModel``, compiled.
            data: ``mujoco.MjData`` of the simulation that is stepped.
            path: a file ending in ``.zip``.
            frame_dt: s; this and the next two as ``RolloutRecorder`` says.
            substeps: look at every physics step.
            settings: roles, kinds, fingers, up, tags, fields of the header.

        Raises:
            RecordError: another ending, or a name that is no body of the model.
        """
        import mujoco

        super().__init__(path, [model.body(i).name for i in range(model.nbody)], frame_dt, settings)
        self._mj, self._model, self._data = mujoco, model, data
        names, told = self.body_names, self._told
        facts = BodyFacts(model, names, told, mujoco)
        self._sides_guessed = facts.guessed
        self._scratch = mujoco.MjData(model)
        self._opening = Opening(model, self._scratch, facts, mujoco)
        self._scene = scene = ModelScene(model, names, facts, told.ups, told.tags, mujoco)
        told.roles = {
            role: [names[scene.whole.get(names.index(n), names.index(n))] for n in some]
            for role, some in told.roles.items()
        }
        self._bodies, self._joints, self._meshes = scene.bodies, scene.joints, scene.meshes
        self._without_shape = scene.without_shape
        self._version_of_simulator = mujoco.__version__
        self._physics_dt = float(model.opt.timestep)
        self._gravity = tuple(model.opt.gravity)
        pyramidal = int(model.opt.cone) == int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
        memory = StepMemory(data, self._scratch)
        self._contact_log = ContactLog(model, memory, scene.geom_index, pyramidal)
        self._copy_contacts, self._clock = self._contact_log.copy, memory.time
        self._runge_kutta = int(model.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4)
        self._views = FrameViews(model, data, scene)
        self._gap = (frame_dt or 0.0) - 0.5 * self._physics_dt
        self._seen = self._since = 0
        # physics steps in the shortest control step so far; before the last of them no frame is kept
        self._fewest = 0
        self._counted = False
        self._held: tuple[float, bytes, bytes | None] | None = None
        self._whole = self._taken = False
        self._late, self._unsure = 0.0, 3
        self._joint_state = self._views.joints()
        self._moment = self._started = self._latest = self._clock.value
        self._next = self._last = -np.inf
        if self._at_present() is not False and np.any(data.xquat[1:]):
            self._take_frame()
        self._copied: list[tuple[float, bytes, bytes, bytes | None]] = []
        if substeps:
            step_hook.watch(mujoco, data, self)
        else:
            self.step = self._step_alone()  # type: ignore[method-assign]

    @property
    def time(self) -> float:
        """s, time of the simulation."""
        return self._clock.value  # type: ignore[no-any-return]

    def substep(self) -> None:
        """Look at the forces of a physics step; only where ``mujoco.mj_step`` is not what steps."""
        self._open()
        self._catch_up()
        if not self._seen:
            self._counted = True
            self._contact_log.take()

    # ------------------------------------------------------------------ called at physics steps

    def take_steps(self, step: Callable[..., None], model: Any, data: Any, count: int) -> None:
        """Take physics steps; where none of them can be a frame, look at its contacts alone."""
        take, light = self._contact_log.take, 0
        if self._frame_dt is None and not self._runge_kutta:
            light = count - 1
            for _ in range(light):
                step(model, data)
                take()
            if light:
                self._passed(light)
        clock = self._clock
        for _ in range(count - light):
            if self._frame_dt is None or self._runge_kutta or clock.value > self._next:
                self.before_step()
                step(model, data)
                self.after_step()
            else:
                step(model, data)
                take()
                self._passed(1)

    def _passed(self, steps: int) -> None:
        """Count physics steps whose contacts alone were looked at."""
        self._seen += steps
        self._since += steps
        self._whole = True

    def before_step(self) -> None:
        """A physics step begins: joints are now what its poses will be."""
        self._moment = moment = self._clock.value
        if moment > self._next or self._frame_dt is None:
            self._joint_state = self._views.joints()
            self._held = None

    def after_step(self) -> None:
        """A physics step has ended; contacts and forces are of the moment before it."""
        if self._runge_kutta:
            self._moment, self._joint_state = self._clock.value, self._views.joints()
        self._seen += 1
        self._since += 1
        self._whole = True
        if self._moment > self._next and self._frame_dt is not None:
            self._take_frame()
        elif self._frame_dt is None:
            self._contact_log.take_last()
            self._taken = True
        else:
            self._contact_log.take()

    def before_contacts(self) -> None:
        """Contacts are about to be found anew without forces: keep what the step before left."""
        if self._whole and self._frame_dt is None:
            if self._since >= self._fewest:
                contacts = None if self._taken else self._copy_contacts()
                self._held = self._moment, self._views.copy(self._joint_state), contacts
            self._whole = False

    def after_forward(self) -> None:
        """All of the data belongs to the present moment."""
        self._moment, self._joint_state = self._clock.value, self._views.joints()
        self._held, self._whole, self._taken = None, True, False

    # ------------------------------------------------------------------ inside

    def _end_step(self) -> float:
        now: float = self._clock.value
        if now < self._latest:
            self._refuse(now)
        if not self._since:  # nobody told of steps
            if self._unsure:
                self._ask_whether_late()
            if self._take_moment(now - self._late):
                self._waiting.append(_join(self._views.all))
                self._contact_log.end_frame(self._copy_contacts())
            return now
        since, self._since = self._since, 0
        if self._frame_dt is None:
            self._fewest = min(since, self._fewest) or since
            held = self._held
            if held is not None:
                if self._take_moment(held[0]):
                    self._waiting.append(held[1])
                    self._contact_log.end_frame(held[2])
                    self._taken = False
            elif (
                self._whole
            ):  # else it is shorter than all before, and its end was not known in time
                self._take_frame()
        return now

    def _step_alone(self) -> Callable[..., None]:
        """``step`` where no physics step is seen: in the usual case it only copies, to ``_copied``.

        Simulators need the processor's caches for themselves, so that every attribute, call and list that is
        looked at takes several times as long as in a loop of its own.
        """
        clock, views, copy, copied = self._clock, self._views.all, self._copy_contacts, self._copied
        add, usual, kind, last = copied.append, super().step, self._kind, np.inf

        def step(action: Any = None) -> None:
            nonlocal kind, last
            now = clock.value
            if (
                now <= last
                or monotonic() > self._due
                or getattr(action, "dtype", action) is not kind
                or len(copied) >= MOST_WAITING
            ):
                self._catch_up()
                usual(action)
                kind, last = self._kind, np.inf if self._unsure else now + 1e-9
                return
            last = now + 1e-9
            add((now, _join(views), copy(), None if action is None else action.tobytes()))

        step.__doc__ = usual.__doc__
        return step

    def _catch_up(self) -> None:
        """Take the frames that were only copied."""
        if not self._copied:
            return
        ends, frames, contacts, actions = zip(*self._copied)
        self._copied.clear()
        before = len(self._times)
        self._times += [now - self._late for now in ends]
        self._latest, self._last, self._action = ends[-1], self._times[-1] + 1e-9, actions[-1]
        self._acted += zip(ends, range(before + 1, len(self._times) + 1), actions)
        self._waiting += frames
        for each in contacts:
            self._contact_log.end_frame(each)

    def _ask_whether_late(self) -> None:
        """Look whether poses are those of this moment, or of the physics step before."""
        present = self._at_present()
        if present is not None:
            self._unsure -= 1
            self._late = 0.0 if present or self._runge_kutta else self._physics_dt

    def _watch_no_more(self) -> None:
        step_hook.unwatch(self._mj, self._data)

    def _sees(self) -> bool:
        return self._counted or self._seen > 0

    def _take_moment(self, moment: float) -> bool:
        """Begin a frame; there is none of the moment of the last one."""
        if moment <= self._last:
            return False
        if not self._times:
            self._still = self._views.still()
        self._last = moment + 1e-9
        self._next = moment + self._gap
        self._times.append(moment)
        return True

    def _take_frame(self) -> None:
        """Keep a frame of what belongs to the moment that was reported last."""
        if self._take_moment(self._moment):
            self._waiting.append(self._views.copy(self._joint_state))
            self._contact_log.end_frame(None if self._taken else self._copy_contacts())
            self._taken = False

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

    def _columns(self, frames: list[bytes]) -> dict[str, Any]:
        columns, coordinates = self._views.columns(frames)
        columns["gripper"] = self._opening.at(coordinates)
        return columns
