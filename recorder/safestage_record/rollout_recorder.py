"""Recording common to all simulators: control steps, success, the file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import Any, Sequence

import numpy as np

from ._version import __version__
from .record_error import RecordError
from .rollout_log import RolloutLog
from .scene_parts import MeshStore
from .scene_report import guess_ups, remarks, report
from .told_facts import SETTINGS, ToldFacts, tell_apart

FRAME_DT = 0.01
"""s between frames. Control steps of 0.05 s are too far apart to tell how something moved or fell."""

MOST_WAITING = 1024
"""Frames, and ``LONGEST_WAIT`` s: what of a recording is lost at most if the process is killed."""
LONGEST_WAIT = 1.0


class RolloutRecorder(ABC):
    """Records one rollout; as a context manager it writes the file at the end of the block.

    A subclass for a simulator sets ``_bodies``, ``_joints``, ``_meshes`` and calls ``_keep`` for
    each frame; ``_columns`` and ``_contacts`` turn frames into arrays, many at a time.

    Every simulator's recorder takes these settings as keywords, and further fields of the trace's header
    (episode_id, task, stage, instruction, policy, seed, rollout, goal, rules, parameters, horizon, …):

        roles: role of the safety rules → name or names of bodies.
        kinds: body name → robot, gripper, object, fixture or region, where guessed wrong; it holds for what
            hangs on the body, too.
        fingers: body name → left or right, where guessed wrong.
        up: body name → unit vector (3,) of the body frame that points up when it stands as intended;
            ``"guess"``: of each object the axis that does at the first frame.
        tags: body name → words that rules ask for (fragile, liquid, sharp, …).
        frame_dt: s between frames, to the next physics step; None: one frame per ``step``, as always where
            physics steps are not seen.
        substeps: look at every physics step, so that forces between two frames are known.

    Attributes:
        body_names: all bodies, as the trace names them.
        path: the file that ``close`` writes.
    """

    simulator = ""
    force_source = "recorded"
    body_names: list[str]
    _bodies: list[dict[str, Any]]
    _joints: list[dict[str, Any]]
    _meshes: MeshStore
    _version_of_simulator = ""
    _physics_dt = 0.0
    _gravity: Sequence[float] = (0.0, 0.0, -9.81)
    _sides_guessed = False
    _without_shape: Sequence[str] = ()
    _unrecorded = 0

    def __init__(
        self,
        path: str | Path,
        names: Sequence[str],
        frame_dt: float | None,
        settings: dict[str, Any],
    ) -> None:
        """``names``: of the bodies in the simulator. Raises RecordError for names that are none of them."""
        self.path = Path(path)
        if self.path.suffix.lower() != ".zip":
            raise RecordError(
                f"{path}: recordings are ZIP files. Allowed: a name ending in .zip. "
                "safestage convert makes MCAP and Parquet of them."
            )
        self.body_names = tell_apart(names)
        said = {name: settings.pop(name) for name in SETTINGS if name in settings}
        self._told = ToldFacts(self.body_names, **said)
        self._frame_dt, self._fields = frame_dt, settings
        self._meshes = MeshStore()
        self._log = RolloutLog(self.path)
        self._waiting: list[Any] = []
        self._acted: list[tuple[float, int, bytes | None]] = []
        self._action: bytes | None = None
        self._kind: Any = None
        self._times: list[float] = []
        self._steps: list[float] = []
        self._latest = 0.0
        self._success: bool | None = None
        self._success_time: float | None = None
        self._closed = False
        self._due = -np.inf
        self._first: Any = None
        self._started = 0.0

    # ------------------------------------------------------------------ what the user calls

    def step(self, action: Any = None) -> None:
        """End a control step: call it after each, with the action that it carried out.

        Args:
            action: (A,) the command; always of one length, or never given.

        Raises:
            RecordError: the recording is closed, or the simulation's time went back.
        """
        if self._closed:
            self._open()
        self._latest = now = self._end_step()
        if action is not None:
            if getattr(action, "dtype", 0) is not self._kind:
                action = self._cast(action)
            self._action = action.tobytes()
        self._acted.append((now, len(self._times), self._action))
        if len(self._waiting) >= MOST_WAITING or monotonic() > self._due:
            self._flush()

    def success(self, reached: bool | None = True) -> None:
        """Say whether the task's goal is reached; the last frame is the time of the first success."""
        if reached is None:
            return
        if reached and not self._success and len(self):
            self._success_time = self._times[-1] - self._times[0]
        self._success = bool(reached) or bool(self._success)

    def header(self, **fields: Any) -> None:
        """Set further fields of the header (``termination``, ``post_success_hold``, …)."""
        self._fields.update(fields)

    def report(self) -> str:
        """Lines on what was recorded, guessed and is missing, and what to pass where a guess is wrong."""
        return "\n".join(f"{name}: {text}" for name, text in self._tell().items())

    def tells(self) -> str:
        """One line: which rules on grasps, tilts and forces this recording can decide."""
        told = self._tell()
        return ";  ".join(f"{name}: {told[name]}" for name in ("held", "tilt", "forces"))

    @property
    def succeeded(self) -> bool:
        """Whether the goal was reached so far."""
        return bool(self._success)

    @property
    def stepped(self) -> int:
        """Control steps so far."""
        self._catch_up()
        return len(self._steps) + len(self._acted)

    @property
    @abstractmethod
    def time(self) -> float:
        """s, time of the simulation."""

    def __len__(self) -> int:
        """Frames so far."""
        self._catch_up()
        return len(self._times)

    def close(self) -> Path:
        """Write the file, whole or not at all, and return its path.

        Raises:
            RecordError: no frame was recorded, or the file cannot be written.
        """
        self._stop()
        if not len(self):
            raise RecordError(f"{self.path}: no frame was recorded. Call step() after each action.")
        self._flush()
        self._log.write(self._header())
        return self.path

    def stop(self) -> None:
        """Record no further, and write nothing."""
        self._stop()
        self._log.drop()

    def __enter__(self) -> Any:
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

    # ------------------------------------------------------------------ what a simulator supplies

    @abstractmethod
    def _end_step(self) -> float:
        """Keep what frames a control step still lacks; return the simulation's time, s."""

    @abstractmethod
    def _columns(self, frames: list[Any]) -> dict[str, Any]:
        """``BODY_COLUMNS`` (T, M, 3 or 4), joints and gripper (T, width) of frames as kept."""

    @abstractmethod
    def _contacts(self) -> tuple[Any, Any]:
        """(C,) CONTACT_POINT of the frames since the last call, and (T,) how many each has."""

    @abstractmethod
    def _fixed(self) -> tuple[Any, Any]:
        """(F, 3) m and (F, 4) wxyz, poses of the bodies that do not move."""

    @abstractmethod
    def _sees(self) -> bool:
        """Whether physics steps between frames are looked at."""

    def _watch_no_more(self) -> None:  # noqa: B027 - only where something was hooked in
        """Leave the simulator as it was."""

    def _catch_up(self) -> None:  # noqa: B027 - only where steps are copied without being counted
        """Take the steps that were only copied."""

    # ------------------------------------------------------------------ inside

    def _open(self) -> None:
        if self._closed:
            raise RecordError(f"{self.path}: the recording is closed. Begin another one.")

    def _refuse(self, now: float) -> None:
        """Raise RecordError: the simulation's time went back."""
        raise RecordError(
            f"{self.path}: the simulation went back from {self._latest:.6g} s to {now:.6g} s. "
            "Close this recording before a reset and begin another."
        )

    def _stop(self) -> None:
        self._closed, self._due = True, -np.inf
        self._watch_no_more()

    def _keep(self, moment: float, frame: Any) -> bool:
        """Append a frame of a moment (s); one of the same moment as the last is none."""
        times = self._times
        if times and moment <= times[-1] + 1e-9:
            return False
        times.append(moment)
        self._waiting.append(frame)
        return True

    def _cast(self, action: Any) -> Any:
        """An action in the numbers that the first one had, so that most are copied as they are."""
        if self._kind is None:
            wide = getattr(action, "dtype", None) == np.float64
            self._kind = np.dtype(np.float64 if wide else np.float32)
        return np.array(action, self._kind)

    def _take_actions(self, count: int) -> Any:
        """(count, A) the action of the control step that each of the last frames belongs to."""
        times, ends, given = zip(*self._acted, (self._latest, len(self._times), self._action))
        self._steps += times[:-1]
        self._acted.clear()
        if self._action is None:
            return np.zeros((count, 0))
        nothing = bytes(len(self._action))
        block = b"".join([nothing if action is None else action for action in given])
        if len(block) != len(given) * len(nothing):
            raise RecordError(f"{self.path}: actions of several lengths. Allowed: always the same.")
        table = np.frombuffer(block, self._kind).reshape(len(given), -1)
        frames = np.arange(len(self._times) - count, len(self._times))
        return table[np.searchsorted(ends, frames, side="right")]

    def _flush(self) -> None:
        """Turn the frames that wait into arrays, and write them to the journal."""
        self._catch_up()
        if not self._waiting:
            return
        frames = self._waiting[:]
        self._waiting.clear()
        columns = self._columns(frames)
        columns["t"] = np.array(self._times[-len(frames) :], np.float64)
        columns["contacts"], columns["counts"] = self._contacts()
        columns["action"] = self._take_actions(len(frames))
        if not self._log.begun:
            self._first = columns["orientation"][0]
            if self._told.guess_up:
                for body, axis in self._proposed():
                    if body["up_axis"] is None:
                        body["up_axis"] = axis
                        body["untold"] = [name for name in body["untold"] if name != "up_axis"]
            scene = {"bodies": self._bodies, "joints": self._joints}
            self._log.begin(scene, self._fixed(), self._meshes)
        self._log.append(columns, self._header())
        if not self._closed:
            self._due = monotonic() + LONGEST_WAIT

    def _proposed(self) -> list[tuple[dict[str, Any], list[float]]]:
        return [] if self._first is None else guess_ups(self._bodies, self._first)

    def _tell(self) -> dict[str, str]:
        if not self._log.begun and not self._closed:
            self._flush()
        sees = self._sees() if self._sees() or self.stepped else None
        proposed = {body["name"]: axis for body, axis in self._proposed()}
        return report(
            self._bodies, proposed, self._told.roles, sees, self._sides_guessed, self._without_shape
        )

    def _header(self) -> dict[str, Any]:
        """The header's fields besides the scene, as they are known by now."""
        step = self._physics_dt
        control = _usual_gap([self._started, *self._steps[-1001:]], step)
        frame = control
        if self._frame_dt is not None and self._sees() and len(self._times) > 1:
            frame = _usual_gap(self._times, step)
        guessed = len(self._proposed()) if self._told.guess_up else 0
        header = {
            "schema_version": "1.2",
            "episode_id": self.path.stem,
            "physics_dt": step,
            "frame_dt": frame,
            "control_dt": control,
            "gravity": [float(g) for g in self._gravity],
            "success": self._success,
            "success_time": self._success_time,
            "termination": "success" if self._success else None,
            "roles": self._told.roles,
            "force_source": self.force_source,
            "source": {
                "simulator": self.simulator,
                "simulator_version": self._version_of_simulator,
                "recorder": "safestage-record",
                "recorder_version": __version__,
                "account": [
                    *remarks(self._sides_guessed, guessed, self._sees(), self._unrecorded),
                    *self._own_remarks(),
                ],
            },
        }
        return {**header, **self._fields}

    def _own_remarks(self) -> list[dict[str, str]]:
        """Facts that this simulator does not provide."""
        return []


def _usual_gap(times: list[float], step: float) -> float:
    """The median gap (s) between times, in whole physics steps; one step where there is none."""
    gaps = np.sort(np.diff(times[-1001:]))
    return max(1, round(float(gaps[len(gaps) // 2]) / step)) * step if len(gaps) else step
