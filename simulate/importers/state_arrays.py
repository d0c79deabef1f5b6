"""Plain arrays: an ``.npz`` with ``qpos`` and ``qvel``, and an MJCF file (MJX, MuJoCo Warp, own scripts).

``qpos`` (T, nq) and ``qvel`` (T, nv); of many environments at once (N, T, nq) and (N, T, nv). It may have
``time`` (T,) or ``dt``, ``action`` (T, A), ``ctrl`` (T, nu), ``success`` and ``mujoco_version``. The model is the file
of the same name that ends in .xml, or ``model.xml`` beside it.
"""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError
from safestage_eval.importers.importer import SourceError
from safestage_eval.importers.npz_arrays import npz_arrays, npz_names

from .stored_states import Stored

NEEDED = {"qpos", "qvel"}
WANTED = (*sorted(NEEDED), "time", "dt", "action", "ctrl", "success", "mujoco_version")
LARGEST = 1 << 28
"""bytes of a model's text."""


class StateArrays:
    """One ``.npz`` file with its model."""

    def __init__(self, path: Path) -> None:
        """Read the arrays. Raises SourceError when they do not belong together."""
        self._path = path
        self._arrays = npz_arrays(path, WANTED)
        qpos, qvel = self._arrays["qpos"], self._arrays["qvel"]
        if qpos.ndim not in (2, 3) or qvel.ndim != qpos.ndim or qpos.shape[:-1] != qvel.shape[:-1]:
            raise SourceError(
                str(path), f"qpos has the shape {qpos.shape} and qvel {qvel.shape}.",
                "(T, nq) and (T, nv), or (N, T, nq) and (N, T, nv) of N environments",
            )  # fmt: skip
        self._many = qpos.ndim == 3

    @classmethod
    def told_by(cls, path: Path) -> str | None:
        """By its arrays; None if it has others."""
        if path.suffix.lower() != ".npz" or not path.is_file():
            return None
        return "qpos and qvel" if npz_names(path) >= NEEDED else None

    def names(self) -> list[str]:
        """``env_0`` … of many environments, else ``states``."""
        return [f"env_{i}" for i in range(len(self._arrays["qpos"]))] if self._many else ["states"]

    def fingerprint(self, name: str) -> str:
        """Digest of the states and the model."""
        digest = sha256((self._model() or "").encode())
        for key in sorted(NEEDED):
            digest.update(np.ascontiguousarray(self._part(key, name)).tobytes())
        return digest.hexdigest()[:16]

    def read(self, name: str) -> Stored:
        """One episode."""
        qpos, qvel = self._part("qpos", name), self._part("qvel", name)
        time = self._part("time", name) if "time" in self._arrays else np.zeros(0)
        if "time" in self._arrays and time.shape != (len(qpos),):
            raise SourceError(
                str(self._path), f"time has the shape {time.shape}.", f"({len(qpos)},)"
            )
        clock = time if len(time) else np.arange(len(qpos), dtype=np.float64)
        version, dt = self._arrays.get("mujoco_version"), self._arrays.get("dt")
        about: dict[str, Any] = {} if version is None else {"mujoco_version": str(version)}
        if dt is not None and dt.size == 1 and float(dt.ravel()[0]) > 0:
            about["env_info"] = {"control_freq": 1 / float(dt.ravel()[0])}
        ctrl = self._columns("ctrl", name)
        success = self._part("success", name) if "success" in self._arrays else None
        return Stored(
            where=f"{self._path}:{name}",
            model=self._model(),
            states=np.column_stack([clock, qpos, qvel]),
            actions=self._columns("action", name) if "action" in self._arrays else ctrl,
            ctrl=ctrl,
            about=about,
            index=int(name.removeprefix("env_")) if self._many else None,
            successful=None if success is None else bool(np.any(success)),
            clocked=bool(len(time)),
        )

    def close(self) -> None:
        """Nothing stays open."""

    def _columns(self, key: str, name: str) -> NDArray[Any]:
        """(T, A); A is 0 where there are none."""
        values = self._part(key, name) if key in self._arrays else np.zeros((0, 0))
        return values if values.ndim == 2 else np.zeros((0, 0))

    def _part(self, key: str, name: str) -> NDArray[Any]:
        values = self._arrays[key]
        own = self._many and (values.ndim > 1 or key == "success")
        return np.atleast_1d(values[int(name.removeprefix("env_"))] if own else values)

    def _model(self) -> str | None:
        for file in (self._path.with_suffix(".xml"), self._path.with_name("model.xml")):
            if file.is_file():
                if file.stat().st_size > LARGEST:
                    raise InputError(str(file), "has more than 256 MiB of text.")
                return file.read_text("utf-8", errors="replace")
        raise SourceError(
            str(self._path), "has states, but there is no model to put them into.",
            fix=f"the MJCF as {self._path.stem}.xml or model.xml beside it, in one piece "
            "(mj_saveLastXML writes it)",
        )  # fmt: skip
