"""One rollout: a policy in a task's scene, recorded whole, success watched live."""

from __future__ import annotations

import hashlib
import re
import traceback
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Header, Source
from safestage_eval.errors import InputError
from safestage_eval.formats import TraceWriter
from safestage_eval.verdicts.goal import GoalMonitor
from safestage_eval.version import __version__
from simulate.cameras.camera_video import CameraVideo
from simulate.cameras.droid_cameras import SIZE, Cameras, camera_facts
from simulate.cameras.lookback import Lookback
from simulate.looks.room import look_numbers
from simulate.policies.reference_policies import Reference
from simulate.policy import Observation, Policy, PolicyError
from simulate.tasks.task import Task
from simulate.world.privileged import PrivilegedState
from simulate.world.world import CONTROL_RATE, FRAME_RATE, FRAMES_PER_ACTION, World

from .recorder import Recorder
from .watch import Watch, Watching

F64 = NDArray[np.float64]
Result = TypeVar("Result")

SETTLE_TIME = 1.0
"""s that a scene comes to rest before its first frame."""
HOLD_TIME = 5.0
"""s recorded after success, with the arm frozen."""

PROMPTS = ("default", "generic", "specific")


@dataclass(frozen=True)
class Setting:
    """Setting of one rollout."""

    task: Task
    seed: int = 0
    prompt: str = "default"
    rollout: int = 0
    horizon: float | None = None
    """s; the task's own where None."""
    robot_mjcf: Path | None = None

    @property
    def draw(self) -> tuple[int, int, int]:
        """Seed of a policy's randomness, from task, environment seed and rollout."""
        return zlib.crc32(self.task.id.encode()), self.seed, self.rollout

    @property
    def look(self) -> tuple[int, int]:
        """Seed of cameras, room and light, equal for all rollouts of an environment seed."""
        return look_numbers(self.task.id, self.seed)

    def episode_id(self, policy: str) -> str:
        """Id that is the same whenever the rollout is recorded.

        What departs from the task's own setting (a horizon, another arm model) is part of it.
        """
        said = policy.replace("=-", "=minus")
        parts = [self.task.id, re.sub(r"[^\w.]+", "-", said), self.prompt]
        parts += [f"s{self.seed}", f"r{self.rollout}"]
        if self.horizon is not None and self.horizon != self.task.horizon:
            parts.append(f"h{self.horizon:g}")
        if self.robot_mjcf is not None:
            parts.append(self.robot_mjcf.stem)
        return ".".join(parts)


def roll_out(
    setting: Setting, policy: Policy, video: Path | None = None, watching: Watching | None = None
) -> TraceWriter:
    """Run one episode to its end.

    Success is the task's goal, judged as the evaluator judges it: live, on the frames recorded so
    far. When it comes, the arm is frozen at its *measured* pose (its commands are 0.2 s ahead) with
    the gripper as commanded, and five more seconds are recorded.

    Args:
        setting: task, seed, prompt.
        policy: what acts.
        video: an MP4 to be made of what the cameras see, 15 pictures a second.
        watching: rules that are judged meanwhile. A rollout that they stop is ``truncated``, and
            without success unless that had come; a note says by what.

    Returns:
        A writer that holds all frames, ready to be closed to a file.

    A policy from which no action can be had, whatever it raises, ends the episode: its
    ``termination`` is ``error``, its success unknown, and the reason stands in its notes. Without a
    first action the episode is one control step long, in which the arm holds still.

    Raises:
        InputError: a reference names a skill that does not exist, or cannot be reached.
    """
    task = setting.task
    if setting.prompt not in PROMPTS:
        raise InputError(f"prompt {setting.prompt!r}", "no such prompt.", ", ".join(PROMPTS))
    wanted = tuple(getattr(policy, "cameras", ()))
    world = start(setting)
    header = _header(setting, policy.name)
    recorder = Recorder(world, header)
    writer = recorder.writer
    size = getattr(policy, "image_size", SIZE)
    cameras = Cameras(world, wanted, size) if wanted else None
    film = None if video is None else CameraVideo(world, video)
    writer.update_header(
        cameras=camera_facts(world, wanted, size), video=None if film is None else film.about
    )
    watch = None if watching is None else watching.of(writer)
    try:
        _told(policy, lambda: policy.reset(task.id, header.instruction or ""))
        if isinstance(policy, Reference):
            policy.look(task, PrivilegedState(world))
        success, stopped = _play(setting, world, recorder, policy, cameras, film, watch)
    except PolicyError as error:
        if not len(writer):
            still = np.append(world.arm_position, 0.0)
            world.act(still, lambda substep: recorder.step(substep, still))
        writer.update_header(termination="error", notes=(*header.notes, f"error: {error}"))
        return writer
    finally:
        if cameras is not None:
            cameras.close()
        if film is not None:
            film.close()
        getattr(policy, "close", lambda: None)()
    ended = "truncated" if stopped else "success" if success is not None else "horizon"
    hold = min(HOLD_TIME, len(writer) / FRAME_RATE - success) if success is not None else None
    writer.update_header(
        success=success is not None,
        success_time=success,
        termination=ended,
        post_success_hold=hold,
        notes=(notes := (*header.notes, *getattr(policy, "notes", ()))),
    )
    if watch is not None and stopped:
        notes = (*notes, f"stopped at the first violation: {', '.join(watch.seen)}")
        writer.update_header(notes=notes)
    elif watch is not None:
        watch.conclude()
    return writer


def start(setting: Setting) -> World:
    """The scene of a setting, come to rest, with the arm at home."""
    task = setting.task
    world = World(
        task.models(), substeps=task.substeps, robot_mjcf=setting.robot_mjcf, look=setting.look
    )
    world.reset(task.layout(setting.seed))
    home = np.append(world.arm_position, 0.0)
    for _ in range(round(SETTLE_TIME * CONTROL_RATE)):
        world.act(home)
    return world


def _play(
    setting: Setting,
    world: World,
    recorder: Recorder,
    policy: Policy,
    cameras: Cameras | None,
    film: CameraVideo | None,
    watch: Watch | None,
) -> tuple[float | None, bool]:
    """Act and record until the episode ends; the time of success, and whether the watch ended it."""
    writer, instruction = recorder.writer, recorder.writer.header.instruction or ""
    monitor = GoalMonitor.of(writer.header)
    horizon = setting.horizon or setting.task.horizon
    success: float | None = None
    frozen = np.append(world.arm_position, 0.0)
    chunk: list[F64] = []
    length = 0
    back = Lookback(getattr(policy, "lookback", ()))
    while True:
        now = len(writer) / FRAME_RATE
        if success is None and now >= horizon:
            break
        if success is not None and now > success + HOLD_TIME:
            break
        if success is None:
            step = round(now * CONTROL_RATE)
            if not chunk:
                seen = observe(world, now, instruction, cameras, objects=tracks_objects(policy))
                back.keep(step, seen.images)
                seen = replace(seen, past=back.past(step))
                chunk = _told(policy, lambda seen=seen: _checked(policy.act(seen), policy.name))  # type: ignore[misc]
                length = len(chunk)
            elif cameras is not None and back.due(length - len(chunk), length):
                back.keep(step, cameras.images())
            action = chunk.pop(0)
        else:
            action = frozen
        if film is not None:
            film.picture()
        world.act(action, lambda substep, a=action: recorder.step(substep, a))  # type: ignore[misc]
        if success is None:
            success = _watch(monitor, writer)
            frozen = np.append(world.arm_position, action[7])
        if watch is not None and watch.look(success):
            return success, True
    return success, False


def _watch(monitor: GoalMonitor, writer: TraceWriter) -> float | None:
    last = len(writer)
    back = monitor.window_frames
    first = 0 if back is None else max(0, last - FRAMES_PER_ACTION - back)
    return monitor.update(writer.window(first, last), FRAMES_PER_ACTION)


def observe(
    world: World,
    time: float,
    instruction: str,
    cameras: Cameras | None = None,
    *,
    objects: bool = False,
) -> Observation:
    """The observation of a world now, with the poses of its objects if they are asked for."""
    return Observation(
        time,
        world.arm_position,
        world.gripper_opening,
        instruction,
        np.array(world.data.qvel[world.arm_dof]),
        {} if cameras is None else cameras.images(),
        (),
        *world.flange,
        world.object_poses() if objects else {},
    )


def tracks_objects(policy: Policy) -> bool:
    """Whether a policy wants the poses of objects."""
    return bool(getattr(policy, "tracks_objects", False))


def _told(policy: Policy, do: Callable[[], Result]) -> Result:
    """A policy's actions; any failure but an InputError becomes a PolicyError."""
    try:
        return do()
    except InputError:
        raise
    except Exception as error:
        said = str(error).strip().splitlines() or ["no reason given"]
        at = traceback.extract_tb(error.__traceback__)[-1]
        raise PolicyError(
            f"policy {policy.name!r}, {Path(at.filename).name}, line {at.lineno}",
            f"{type(error).__name__}: {said[-1]}",
        ) from error


def _checked(actions: F64, policy: str) -> list[F64]:
    chunk = np.asarray(actions, np.float64)
    fits = chunk.ndim == 2 and chunk.shape[1] == 8 and len(chunk) > 0
    if not fits:
        message = f"its actions are of shape {chunk.shape}."
        raise PolicyError(f"policy {policy!r}", message, "(N, 8) finite numbers")
    if not np.isfinite(chunk).all():
        row = int(np.argmin(np.isfinite(chunk).all(axis=1)))
        raise PolicyError(f"policy {policy!r}", f"action {row} of its answer is not finite.")
    return list(chunk)


def _header(setting: Setting, policy: str) -> Header:
    task = setting.task
    digest = hashlib.sha256(task.model_dump_json().encode()).hexdigest()[:12]
    return Header(
        episode_id=setting.episode_id(policy),
        task=task.id,
        stage=task.stage,
        family=task.family,
        instruction=getattr(task.prompts, setting.prompt),
        prompt=setting.prompt,
        policy=policy,
        seed=setting.seed,
        rollout=setting.rollout,
        physics_dt=1.0 / (FRAME_RATE * task.substeps),
        frame_dt=1.0 / FRAME_RATE,
        control_dt=1.0 / CONTROL_RATE,
        horizon=setting.horizon or task.horizon,
        roles=task.roles,
        goal=task.goal,
        rules=task.rules,
        parameters=task.parameters,
        force_source="recorded",
        source=Source(
            simulator="MuJoCo",
            simulator_version=mujoco.__version__,
            recorder="safestage",
            recorder_version=__version__,
            licence="Apache-2.0",
        ),
        notes=(f"task {digest}", f"arm model: {_arm_model(setting.robot_mjcf)}"),
    )


def _arm_model(mjcf: Path | None) -> str:
    if mjcf is None:
        return f"tabletask {version('tabletask')}"
    return f"{mjcf.name} {hashlib.sha256(mjcf.read_bytes()).hexdigest()[:12]}"
