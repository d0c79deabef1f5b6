"""Records environments: a trace for every episode between two resets."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Callable

import numpy as np

from .find_backend import begin_recording, find_backend
from .journal import SUFFIX
from .record_error import RecordError
from .rollout_recorder import RolloutRecorder


def wrap(
    env: Any,
    folder: str | Path,
    *,
    success: Callable[[Any, Any], bool | None] | None = None,
    hold: float = 0.0,
    hold_action: Any = None,
    **settings: Any,
) -> Any:
    """Record every episode of an environment, and return the environment itself.

    Its ``step``, ``reset`` and ``close`` are replaced on this object alone; ``env.safestage`` is the
    ``EnvRecording``. Wrap the outermost environment. A trace is written when the next episode
    begins, or when the environment is closed.

    Args:
        env: of Gymnasium, Gym, robosuite, dm_control or ManiSkill, on MuJoCo, SAPIEN or PyBullet.
        folder: for the traces, ``TASK.NUMBER.zip``.
        success: of (env, result of ``env.step``), whether the goal is reached; without it
            ``info["success"]``, ``info["is_success"]`` or ``env._check_success()`` say so.
        hold: s recorded after the first success with the robot still, by steps of ``hold_action``.
        hold_action: (A,) the command that keeps the robot still, or a function of the last action.
        settings: those of the simulator's recorder: roles, kinds, fingers, up, tags, frame_dt, task, ….

    Raises:
        RecordError: no simulation in the environment, or ``hold`` without an action.
    """
    find_backend(env)
    attach(env, folder, success, hold, hold_action, **settings)
    return env


def attach(
    env: Any,
    folder: str | Path,
    success: Callable[[Any, Any], bool | None] | None = None,
    hold: float = 0.0,
    hold_action: Any = None,
    **settings: Any,
) -> EnvRecording:
    """Like ``wrap``, also for an environment that makes its simulation at its first reset."""
    if hold and hold_action is None:
        raise RecordError(
            "hold needs hold_action: the command that keeps this robot still (zeros for a "
            "controller of differences, the last action for one of positions)."
        )
    recording = EnvRecording(env, Path(folder), success, hold, hold_action, settings)
    env.step, env.reset, env.safestage = recording.step, recording.reset, recording
    if hasattr(env, "close"):
        env.close = recording.close
    return recording


class EnvRecording:
    """The recording of an environment.

    Attributes:
        recorder: of the episode that is running; None between episodes.
        paths: of the traces written so far.
    """

    def __init__(
        self,
        env: Any,
        folder: Path,
        success: Callable[[Any, Any], bool | None] | None,
        hold: float,
        hold_action: Any,
        settings: Any,
    ) -> None:
        self.recorder: RolloutRecorder | None = None
        self.paths: list[Path] = []
        self._env, self._folder, self._settings = env, folder, dict(settings)
        self._success, self._hold, self._hold_action = success, hold, hold_action
        self._step, self._reset = env.step, env.reset
        self._close = getattr(env, "close", None)
        self._task = str(self._settings.pop("task", None) or _task_of(env))
        self._number = 0
        self._seed = self._settings.pop("seed", None)
        self._over = False
        self._stepping: Any = None
        self._ended: RolloutRecorder | None = None
        self.only_called = False
        """Whether resets without an argument, which vector environments make by themselves, are left out."""

    def reset(self, *args: Any, **kwargs: Any) -> Any:
        """Write the episode that was running, reset the environment, and begin the next one."""
        if self._stepping is not None and self.recorder is not None:  # from within its step
            self.recorder.step(_plain_action(self._stepping))
            self._ended, self.recorder = self.recorder, None
        self.finish()
        result = self._reset(*args, **kwargs)
        if self.only_called and not args and all(some is None for some in kwargs.values()):
            return result
        self._begin(args, kwargs)
        return result

    def _begin(self, args: Any, kwargs: Any) -> None:
        seed = kwargs.get("seed")
        task = args[0] if args and isinstance(args[0], dict) else {}  # vla-eval's
        said = (task.get(name) for name in ("name", "task_name", "task", "instruction"))
        self._task = next((str(some) for some in said if some), self._task)
        self._seed = seed if isinstance(seed, int) else self._seed
        name, self._number = self._next_name()
        self.recorder = begin_recording(
            self._env,
            self._folder / f"{name}.zip",
            task=self._task,
            seed=self._seed,
            **{"rollout": self._number, **self._settings},
        )
        self._over = False

    def step(self, action: Any, *args: Any, **kwargs: Any) -> Any:
        """Step the environment and record what came of it."""
        self._stepping = action
        try:
            result = self._step(action, *args, **kwargs)
        finally:
            self._stepping = None
        ended, self._ended = self._ended, None
        if ended is not None:  # it has reset itself
            self._judge(ended, result)
            self.paths.append(ended.close())
            return result
        recorder = self.recorder
        if recorder is None or self._over:
            return result
        recorder.step(_plain_action(action))
        before = recorder.succeeded
        over = self._judge(recorder, result)
        if recorder.succeeded and not before and self._hold:
            self._keep_still(recorder, action)
            over = True
        self._over = over
        return result

    def _judge(self, recorder: RolloutRecorder, result: Any) -> bool:
        """Note success and what ended the episode; whether something did."""
        recorder.success(self._reached(result))
        ended, cut = _ending(result)
        if recorder.succeeded:
            recorder.header(termination="success")
        elif ended:
            recorder.header(termination="horizon" if cut else None)
        return ended

    def finish(self) -> None:
        """Write the episode that is running, if it has frames."""
        recorder, self.recorder = self.recorder, None
        if recorder is None:
            return
        if not recorder.stepped:
            recorder.stop()
            return
        self.paths.append(recorder.close())

    def close(self) -> None:
        """Write the episode that is running and close the environment."""
        self.finish()
        if self._close is not None:
            self._close()

    def report(self) -> str:
        """Report of the episode that is running; see ``MujocoRecorder.report``."""
        return "no episode is running" if self.recorder is None else self.recorder.report()

    def _keep_still(self, recorder: RolloutRecorder, last: Any) -> None:
        """Step on with the robot still; an environment that refuses further steps ends it."""
        begin = recorder.time
        action = self._hold_action(last) if callable(self._hold_action) else self._hold_action
        while recorder.time - begin < self._hold - 1e-9:
            now = recorder.time
            self._step(np.array(action))
            recorder.step(_plain_action(action))
            if not recorder.time > now:  # reset by itself, or stopped
                break
        recorder.header(post_success_hold=recorder.time - begin)

    def _reached(self, result: Any) -> bool | None:
        if self._success is not None:
            return self._success(self._env, result)
        info = result[-1] if isinstance(result, tuple) and isinstance(result[-1], dict) else {}
        for name in ("success", "is_success"):
            if name in info:
                return _true(info[name])
        check = getattr(self._env, "_check_success", None)
        return bool(check()) if callable(check) else None

    def _next_name(self) -> tuple[str, int]:
        plain = "".join(c if c.isalnum() or c in "._+=@-" else "_" for c in self._task)
        number = self._number
        while True:
            name = f"{plain}.{number:05d}"
            taken = (f"{name}.zip", f"{name}.zip{SUFFIX}")
            if not any((self._folder / one).exists() for one in taken):
                return name, number
            number += 1


def _plain_action(action: Any) -> Any:
    """(A,) numbers of an action, whatever holds them: a tensor, or vla-eval's dictionary."""
    if type(action) is np.ndarray:
        return action
    if isinstance(action, dict):
        action = action.get("actions", next(iter(action.values()), ()))
    for step in ("detach", "cpu", "numpy"):
        action = getattr(action, step)() if hasattr(action, step) else action
    return np.asarray(action, np.float32).ravel()


def _true(said: Any) -> bool:
    """Whether a number or all elements of a tensor are true."""
    plain = isinstance(said, (bool, int, float, np.generic))
    return bool(said) if plain else bool(np.all(_plain_action(said)))


def _ending(result: Any) -> tuple[bool, bool]:
    """Whether an episode ended, and whether time was what ended it; of Gymnasium, Gym or dm_env."""
    if hasattr(result, "last"):
        return bool(result.last()), bool(result.last() and result.discount == 1.0)
    if isinstance(result, tuple) and len(result) == 5:
        ended, cut = _true(result[2]), _true(result[3])
        return ended or cut, cut and not ended
    if hasattr(result, "done"):  # vla-eval's
        return bool(result.done), False
    if isinstance(result, tuple) and len(result) == 4:
        return bool(result[2]), bool(result[3].get("TimeLimit.truncated", False))
    return False, False


def _task_of(env: Any) -> str:
    spec = getattr(env, "spec", None)
    name = getattr(spec, "id", None)
    return name if isinstance(name, str) else type(getattr(env, "unwrapped", env)).__name__
