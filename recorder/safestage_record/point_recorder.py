"""Base of recorders for simulators that list contacts as points."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, Container, Sequence

import numpy as np

from .point_log import PointLog, Row
from .record_error import RecordError
from .rollout_recorder import RolloutRecorder


class PointRecorder(RolloutRecorder):
    """A frame is taken after a physics step: poses as they then are, contacts and forces of the step.

    A subclass supplies ``_take_frame``, which ends in ``_keep_points``, and ``_points``.
    """

    _stands: tuple[Any, Any]
    _fingers: Sequence[int] = ()
    _looks = True
    """Whether physics steps between frames are looked at; they are counted in any case."""

    def __init__(
        self, path: Any, names: Sequence[str], frame_dt: float | None, settings: dict[str, Any]
    ) -> None:
        """See ``RolloutRecorder``."""
        super().__init__(path, names, frame_dt, settings)
        self._elapsed, self._next = 0.0, -np.inf
        self._seen = 0
        self._point_log = PointLog(self._pack_point, self._read_points)

    @property
    def time(self) -> float:
        """s, the steps so far by their length."""
        return self._elapsed

    def substep(self) -> None:
        """Take a physics step; call it after each where the steps are not seen."""
        self._open()
        self._looks = True
        self.after_step()

    def after_step(self) -> None:
        """A physics step has ended."""
        self._seen += 1
        self._elapsed = self._seen * self._physics_dt
        if not self._looks:
            return
        if self._frame_dt is not None and self._elapsed > self._next:
            self._take_frame()
        else:  # of a step that a frame is taken of, too: it changes no maximum
            self._point_log.take(self._points(self._point_log.first))

    # ------------------------------------------------------------------ what a simulator supplies

    @abstractmethod
    def _take_frame(self) -> None:
        """Copy what is now, and keep it."""

    @abstractmethod
    def _points(self, known: Container[Any] = ()) -> Sequence[Row]:
        """Contacts of the last step that touch; of the pairs that are ``known`` the force is enough."""

    @abstractmethod
    def _pack_point(self, point: Any) -> bytes:
        """Bytes of what the point of a row is made of."""

    @abstractmethod
    def _read_points(self, block: bytes) -> Any:
        """(C,) CONTACT_POINT of packed points, one after the other."""

    # ------------------------------------------------------------------ inside

    def _keep_points(self, frame: Any) -> None:
        points = self._points() if self._seen else ()
        if self._keep(self._elapsed, frame):
            self._next = self._elapsed + (self._frame_dt or 0.0) - 0.5 * self._physics_dt
            self._point_log.end_frame(points)

    def _end_step(self) -> float:
        if not self._seen:
            raise RecordError(
                f"{self.path}: no physics step was seen since the recording began. Call "
                "recorder.substep() after each, and step(action) after each control step."
            )
        if self._frame_dt is None or not self._looks:
            self._take_frame()
        return self._elapsed

    def _sees(self) -> bool:
        return self._looks and self._seen > 0

    def _contacts(self) -> tuple[Any, Any]:
        self._unrecorded = self._point_log.unrecorded
        return self._point_log.finish()

    def _fixed(self) -> tuple[Any, Any]:
        return self._stands

    def _opening(self, positions: Any) -> Any:
        """(T, 1) mean share of the fingers' joints, their upper limits being open; (T, 0) without."""
        limited = [j for j in self._fingers if self._joints[j]["limits"]]
        if not limited:
            return np.zeros((len(positions), 0))
        low, high = np.array([self._joints[j]["limits"] for j in limited]).T
        share = (positions[:, limited] - low) / (high - low)
        return np.clip(share.mean(axis=1, keepdims=True), 0.0, 1.0)
