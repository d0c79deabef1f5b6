"""Hooks for programs that evaluate policies: LeRobot's and vla-eval's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .env_wrap import attach
from .record_error import RecordError


def lerobot(envs: Any, folder: str | Path, **settings: Any) -> Any:
    """Record what LeRobot evaluates in, and return the environments.

    Resets that a vector environment makes by itself, of an episode that ended before the others, begin
    no recording: LeRobot does not count these.

    Args:
        envs: what ``lerobot.envs.factory.make_env`` returns: suite → task → vector environment, or one.
        folder: for the traces, ``SUITE/TASK/ENVIRONMENT`` below it.
        settings: as of ``wrap``.

    Raises:
        RecordError: environments in processes of their own, or none.
    """
    place = Path(folder)
    if isinstance(envs, dict):
        for name, inside in envs.items():
            lerobot(inside, place / str(name), **settings)
        return envs
    inside = getattr(envs, "envs", None)
    if inside is None:
        raise RecordError(
            f"{type(envs).__name__} holds no environments in this process. Allowed: a "
            "SyncVectorEnv; pass --eval.use_async_envs=false."
        )
    for i, env in enumerate(inside):
        recording = attach(env, place / str(i), **settings)
        recording.only_called = True
    return envs


def vla_eval(benchmark: Any, folder: str | Path, **settings: Any) -> Any:
    """Record the episodes of a ``StepBenchmark`` of vla-eval's harness, and return it.

    Success is what its ``get_step_result`` says; ``cleanup`` writes the last trace.

    Args:
        benchmark: it keeps its environment on itself, as the harness's own do (``_env``).
        folder: for the traces.
        settings: as of ``wrap``.
    """
    given = dict(settings)
    given.setdefault("success", lambda one, result: one.get_step_result(result).get("success"))
    recording = attach(benchmark, folder, **given)
    cleanup = benchmark.cleanup

    def finish_and_clean() -> None:
        recording.finish()
        cleanup()

    benchmark.cleanup = finish_and_clean
    return benchmark
