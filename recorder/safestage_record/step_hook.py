"""Sees every physics step of chosen data, whoever takes it through the ``mujoco`` module.

While data are watched, ``mujoco.mj_step``, ``mj_step1``, ``mj_step2`` and ``mj_forward`` are
functions that call the original ones and tell the watcher of these data; with the last one they
are the original ones again. Steps through names that were imported before
(``from mujoco import mj_step``) are not seen.
"""

from __future__ import annotations

from typing import Any, Callable

_NAMES = ("mj_step", "mj_step1", "mj_step2", "mj_forward")
_watchers: dict[int, Any] = {}
_originals: dict[str, Callable[..., None]] = {}


def watch(mujoco: Any, data: Any, watcher: Any) -> None:
    """Call ``watcher``'s ``take_steps``, ``before_step``, ``after_step``, ``before_contacts``, ``after_forward``."""
    if not _originals:
        for name in _NAMES:
            _originals[name] = getattr(mujoco, name)
        mujoco.mj_step, mujoco.mj_step1 = _step, _step1
        mujoco.mj_step2, mujoco.mj_forward = _step2, _forward
    _watchers[id(data)] = watcher


def unwatch(mujoco: Any, data: Any) -> None:
    """Watch these data no longer."""
    _watchers.pop(id(data), None)
    if _originals and not _watchers:
        for name, function in _originals.items():
            setattr(mujoco, name, function)
        _originals.clear()


def _step(m: Any, d: Any, nstep: int = 1) -> None:
    watcher, step = _watchers.get(id(d)), _originals["mj_step"]
    if watcher is None:
        step(m, d, nstep)
    else:
        watcher.take_steps(step, m, d, nstep)


def _step1(m: Any, d: Any) -> None:
    watcher = _watchers.get(id(d))
    if watcher is not None:
        watcher.before_contacts()
    _originals["mj_step1"](m, d)


def _step2(m: Any, d: Any) -> None:
    watcher = _watchers.get(id(d))
    if watcher is not None:
        watcher.before_step()
    _originals["mj_step2"](m, d)
    if watcher is not None:
        watcher.after_step()


def _forward(m: Any, d: Any) -> None:
    _originals["mj_forward"](m, d)
    watcher = _watchers.get(id(d))
    if watcher is not None:
        watcher.after_forward()
