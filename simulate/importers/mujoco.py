"""MuJoCo states of robosuite, robomimic, LIBERO, MimicGen and RoboCasa (docs/import/mujoco.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode, Header, Source
from safestage_eval.importers import Account
from safestage_eval.importers.importer import Importer, Settings, SourceError
from safestage_eval.importers.known_files import MODEL_BY_NAME
from safestage_eval.importers.missing_data import say_last_row

from .foreign_facts import ForeignFacts
from .model_file import Loaded, load_model
from .recorder_mujoco import RecorderMujoco, States
from .state_rows import Rows, episode, split
from .stored_states import STORES, DemoFile, Stored
from .weights import weigh

F64 = NDArray[np.float64]


class MujocoStates(Importer):
    """A file of demonstrations, or a folder of stored states."""

    name: ClassVar[str] = "mujoco"
    title: ClassVar[str] = "MuJoCo states (robosuite, robomimic, LIBERO, MimicGen, RoboCasa, MJX)"

    def __init__(self, path: Path, settings: Settings) -> None:
        """Open the file or list the folder."""
        super().__init__(path, settings)
        self._store = next((s for s in STORES if s.told_by(path)), DemoFile)(path)
        self._last: tuple[str, Loaded] | None = None
        python = settings.python
        self._elsewhere = None if python is None else RecorderMujoco(python)

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By what one of ``STORES`` finds."""
        return next((reason for store in STORES if (reason := store.told_by(path))), None)

    def episodes(self) -> Sequence[str]:
        """``demo_1`` or ``episode_000001``, in the order of their numbers."""
        return self._store.names()

    def fingerprint(self, name: str) -> str:
        """Digest of the model and of the states' first and last row."""
        return self._store.fingerprint(name)

    def close(self) -> None:
        """Close the file, and end the recorder's interpreter."""
        self._store.close()
        if self._elsewhere is not None:
            self._elsewhere.close()

    def _model(self, text: str, where: str) -> Loaded:
        """The compiled model; the same one as before for the same text."""
        if self._last is None or self._last[0] != text:
            self._last = text, load_model(text, where, self.settings.assets)
        return self._last[1]

    def _with_contacts(self, rows: Rows, stored: Stored) -> Rows:
        """With the contacts of the recorder's MuJoCo, if there is one."""
        if self._elsewhere is None or rows.loaded.lost:
            return replace(rows, same=stored.mujoco_version == mujoco.__version__)
        weigh(rows.loaded.model, mujoco.MjData(rows.loaded.model), self.settings.map)
        driven = ForeignFacts(rows.loaded.model).driven
        touches = self._elsewhere.touches(rows.loaded, rows.states, driven, stored.where)
        return replace(rows, touches=touches)

    def read(self, name: str, account: Account) -> Episode:
        """One episode, every row computed anew from its state."""
        stored = self._store.read(name)
        _need_states(stored)
        assert stored.model is not None
        assert stored.states is not None
        loaded = self._model(stored.model, stored.where)
        time, qpos, qvel = split(loaded.model, stored.states, stored.where)
        given = self.settings.dt or self.settings.map.source.dt
        clock = _clock(stored, time, given, account)
        header = _header(stored, clock, loaded.model.opt.timestep, account)
        states = States(clock, qpos, qvel, _ctrl(stored, loaded.model, len(clock)))
        rows = Rows(loaded, states, _of_rows(stored.actions, len(clock)))
        rows = self._with_contacts(rows, stored)
        return episode(rows, header, self.settings.map, account)


IMPORTER = MujocoStates


def _need_states(stored: Stored) -> None:
    if stored.states is None:
        raise SourceError(
            stored.where,
            "has no states: what the objects did is not in this file.",
            "data/demo_i/states, an array of [time, qpos, qvel]",
            "ask its publisher for the file before observations were extracted: robomimic calls it "
            "demo.hdf5, LIBERO and MimicGen keep the states in the files that they publish",
        )
    if stored.model is None:
        raise SourceError(
            stored.where,
            "has states, but no model to put them into.",
            "the attribute model_file (MJCF), or model.xml.gz beside states.npz",
            "take the episode from the file that its collector wrote",
        )
    if not stored.model.lstrip().startswith("<"):
        raise MODEL_BY_NAME.error(Path(stored.where), f" (it says {stored.model[:80]!r})")


def _clock(stored: Stored, time: F64, given: float | None, account: Account) -> F64:
    """(T,) s; from the rows where they have it.

    Raises:
        SourceError: rows without a time, and nothing that gives the step.
    """
    step = np.diff(time)
    if given is None and stored.clocked and (step > 0).all():
        if time[0] > 1e-9:
            account.missing(
                "the first rows",
                f"the recording begins at {time[0]:.3g} s of simulated time",
                cost="what happened before is not judged; its first rows are taken as the state at "
                "reset, which they are not",
            )
        return time
    dt = given or stored.control_dt
    if dt is None:
        raise SourceError(
            stored.where,
            "its rows have no time that increases, and nothing says how far apart they are.",
            fix='--dt SECONDS, or dt = "50 ms" under [source] of a map file',
        )
    if given is None and stored.clocked:
        account.guessed(
            "time", f"the rows' times do not increase: one row per action, {dt:.6g} s apart"
        )
    return np.asarray(dt * np.arange(len(time)), np.float64)


def _of_rows(commands: NDArray[Any], rows: int) -> F64:
    """(T, A) a command for each row; none if their numbers differ."""
    return np.asarray(commands, np.float64) if len(commands) == rows else np.zeros((rows, 0))


def _ctrl(stored: Stored, model: mujoco.MjModel, rows: int) -> F64:
    """(T, nu) the actuators' commands; (T, 0) where they are not stored, or do not tell the actuators' forces."""
    ctrl = stored.ctrl
    if ctrl.shape != (rows, model.nu) or ctrl.dtype.kind not in "iuf" or model.na:
        return np.zeros((rows, 0))
    return _of_rows(ctrl if np.isfinite(ctrl).all() else ctrl[:0], rows)


def _header(stored: Stored, clock: F64, physics_dt: float, account: Account) -> Header:
    frame_dt = float(np.median(np.diff(clock))) if len(clock) > 1 else stored.control_dt
    simulator, version = stored.simulator
    success, success_time = _success(stored, clock, account)
    if len(stored.actions) == 0:
        account.missing("commands", cost="nothing that rules ask")
    return Header(
        episode_id="",
        task=stored.task,
        instruction=stored.instruction,
        rollout=stored.index,
        physics_dt=physics_dt,
        frame_dt=frame_dt or physics_dt,
        control_dt=stored.control_dt,
        success=success,
        success_time=success_time,
        source=Source(simulator=simulator, simulator_version=version),
    )


def _success(stored: Stored, clock: F64, account: Account) -> tuple[bool | None, float | None]:
    """Native success and its time (s from the first row), where the rewards tell it."""
    if stored.rewards_tell_success and stored.rewards is not None:
        hits = np.flatnonzero(stored.rewards > 0)
        if not len(hits):
            return False, None
        after = min(int(hits[0]) + 1, len(clock) - 1)
        if after == len(clock) - 1:
            say_last_row(account)
        return True, float(clock[after] - clock[0])
    if stored.successful is not None:
        account.missing(
            "the moment of success", f"the collector says only that it was {'' if stored.successful else 'no '}success",
            cost="what is judged up to success or after it, unless a goal is bound",
            remedy="--map with success_time, or --bind with a goal",
        )  # fmt: skip
        return stored.successful, None
    if stored.libero is not None:
        account.missing(
            "success",
            "LIBERO marks every last row as done and rewarded, whatever happened",
            cost="what is judged up to success or after it, unless a goal is bound",
            remedy="--bind libero when scoring: the goal is then recomputed",
        )
    else:
        account.missing(
            "success",
            "nothing in the file tells when the goal was reached"
            if stored.rewards is None
            else "rewards that are shaped, or may be, do not tell it",
            cost="what is judged up to success or after it, unless a goal is bound",
            remedy="--map with success and success_time, or --bind with a goal",
        )
    return None, None
