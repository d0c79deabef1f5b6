"""Stored episodes of MuJoCo simulators, whatever files they are in, and what their text fields say.

- HDF5 of robosuite, robomimic, LIBERO and MimicGen: ``data/demo_i/states``.
- Folders: RoboCasa365's ``extras/episode_*/states.npz``, and those of robosuite's DataCollectionWrapper, which writes
  ``ep_<time>/state_<time>.npz``, as many as it flushes, with ``model.xml`` and ``ep_meta.json`` beside them. Its actions
  are pickled, and not read.
- Plain arrays (MJX, MuJoCo Warp, own scripts): an ``.npz`` with ``qpos`` (T, nq) and ``qvel`` (T, nv), of many environments
  at once (N, T, nq) and (N, T, nv). It may have ``time`` (T,) or ``dt``, ``action`` (T, A), ``ctrl`` (T, nu), ``success`` and
  ``mujoco_version``. The model is the file of the same name that ends in .xml, or ``model.xml`` beside it.
"""

from __future__ import annotations

import gzip
import re
import zlib
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval._text.json_text import from_json
from safestage_eval.errors import InputError
from safestage_eval.importers import hdf5
from safestage_eval.importers.importer import SourceError
from safestage_eval.importers.npz_arrays import npz_arrays, npz_names

LARGEST = 1 << 28
"""Bytes of a model's text; large ones have a few million."""


@dataclass(frozen=True)
class Stored:
    """The stored data of one episode.

    Attributes:
        where: as messages say it.
        model: MJCF text; None where the file has none.
        states: (T, 1 + nq + nv) time, qpos, qvel; None where the file has none.
        actions: (T, A); A may be 0.
        ctrl: (T, nu) of the actuators, in force from each row on; nu may be 0.
        rewards: (T,) after each row's action, if any.
        meta: of the episode (``ep_meta``).
        about: of the file: ``env_args``, ``env_info``, ``problem_info`` and the like.
        index: number of the episode.
        successful: whether it was a success, where the collector says so without its moment.
        clocked: its rows have a time.
    """

    where: str
    model: str | None
    states: NDArray[Any] | None
    actions: NDArray[Any] = field(default_factory=lambda: np.zeros((0, 0)))
    ctrl: NDArray[Any] = field(default_factory=lambda: np.zeros((0, 0)))
    rewards: NDArray[Any] | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)
    index: int | None = None
    successful: bool | None = None
    clocked: bool = True

    @property
    def libero(self) -> str | None:
        """``suite/task`` of a LIBERO episode: the name of its problem file; None of any other."""
        file = self.about.get("bddl_file_name") or self._args.get("bddl_file")
        if not isinstance(file, str) or not file.endswith(".bddl"):
            return None
        path = PurePosixPath(file.replace("\\", "/"))
        return f"{path.parent.name}/{path.stem}"

    @property
    def _args(self) -> Mapping[str, Any]:
        return _table(self.about.get("env_args"))

    @property
    def _kwargs(self) -> Mapping[str, Any]:
        return _table(self._args.get("env_kwargs")) or _table(self.about.get("env_info"))

    @property
    def task(self) -> str | None:
        """LIBERO's problem, or the environment's name."""
        name = self.libero or self._args.get("env_name") or self.about.get("env")
        return str(name) if name else None

    @property
    def instruction(self) -> str | None:
        """The instruction, if the file has one."""
        problem = _table(self.about.get("problem_info"))
        said = self.meta.get("lang") or problem.get("language_instruction")
        if isinstance(said, list):
            said = " ".join(map(str, said))
        return str(said) if said else None

    @property
    def simulator(self) -> tuple[str, str | None]:
        """Name and version."""
        version = self.about.get("repository_version") or self._args.get("env_version")
        name = "LIBERO (robosuite)" if self.libero else "robosuite"
        return name, None if version is None else str(version)

    @property
    def mujoco_version(self) -> str | None:
        """Version of MuJoCo that recorded it, where the file says so."""
        places = (self.meta, self.about, self._args, self._kwargs)
        said = next((p["mujoco_version"] for p in places if p.get("mujoco_version")), None)
        return None if said is None else str(said)

    @property
    def control_dt(self) -> float | None:
        """Time between actions in s."""
        rate = self._kwargs.get("control_freq")
        return 1.0 / float(rate) if isinstance(rate, int | float) and rate > 0 else None

    @property
    def rewards_tell_success(self) -> bool:
        """Whether a reward above 0 means that the state after the row's action is a success.

        Not in LIBERO, whose converter rewards every last row, and not with shaped rewards.
        """
        sparse = self._kwargs.get("reward_shaping") is False
        return self.rewards is not None and self.libero is None and sparse


class Store(ABC):
    """A file or folder with stored episodes, open."""

    @classmethod
    @abstractmethod
    def told_by(cls, path: Path) -> str | None:
        """By what a path is such a store; None if it is none."""

    @abstractmethod
    def __init__(self, path: Path) -> None:
        """Open it. Raises InputError when it is damaged."""

    @abstractmethod
    def names(self) -> list[str]:
        """Names of the episodes, in order."""

    @abstractmethod
    def fingerprint(self, name: str) -> str:
        """Digest of an episode's model and states."""

    @abstractmethod
    def read(self, name: str) -> Stored:
        """One episode. Raises InputError when its data are damaged."""

    def close(self) -> None:  # noqa: B027 — most have none open
        """Let go of open files."""


class DemoFile(Store):
    """An HDF5 file of demonstrations."""

    def __init__(self, path: Path) -> None:
        """Raises SourceError when it cannot be opened."""
        self._path, self._file = path, hdf5.open_hdf5(path)

    @classmethod
    def told_by(cls, path: Path) -> str | None:
        """By ``states``, or ``model_file``, of its first demonstration."""
        if not hdf5.is_hdf5(path):
            return None
        with hdf5.open_hdf5(path) as file, hdf5.layout(str(path)):
            for demo in hdf5.demos(file)[:1]:
                if hasattr(demo.get("states"), "shape"):
                    return f"{demo.name[1:]}/states"
                if "model_file" in demo.attrs:
                    return f"the model_file of {demo.name[1:]}"
        return None

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def names(self) -> list[str]:
        """``demo_0``, … by number."""
        return [demo.name.rpartition("/")[2] for demo in hdf5.demos(self._file)]

    def fingerprint(self, name: str) -> str:
        """Of the model, and of the ends of its data."""
        demo = self._file["data"][name]
        with hdf5.layout(f"{self._path}:data/{name}"):
            text = str(demo.attrs.get("model_file", ""))
        return f"{sha256(text.encode()).hexdigest()[:16]}{hdf5.fingerprint(demo)[:16]}"

    def read(self, name: str) -> Stored:
        """One demonstration."""
        where = f"{self._path}:data/{name}"
        with hdf5.layout(where):
            data = self._file["data"]
            demo = data[name]
            keys = ("states", "actions", "ctrl", "rewards")
            columns = {key: np.asarray(demo[key][()]) for key in keys if key in demo}
            return Stored(
                where=where,
                model=_text(demo.attrs.get("model_file")),
                states=columns.get("states"),
                actions=_rows(columns.get("actions")),
                ctrl=_rows(columns.get("ctrl")),
                rewards=columns.get("rewards"),
                meta=_table(demo.attrs.get("ep_meta")),
                about={k: _text(v) or v for k, v in data.attrs.items() if np.ndim(v) == 0},
                index=_number(name),
            )


class StateFolders(Store):
    """Folders of stored states, one for each episode."""

    def __init__(self, path: Path) -> None:
        """List the folders."""
        self._folders = {folder.name: folder for folder in _episode_folders(path)}

    @classmethod
    def told_by(cls, path: Path) -> str | None:
        """By ``episode_*/states.npz``, or robosuite's ``ep_*/state_*.npz``."""
        folders = _episode_folders(path) if path.is_dir() else []
        if not folders:
            return None
        file = "states.npz" if (folders[0] / "states.npz").is_file() else "state_*.npz"
        return f"{folders[0].name}/{file}"

    def names(self) -> list[str]:
        """Names of the folders, in order."""
        return list(self._folders)

    def fingerprint(self, name: str) -> str:
        """Of the states and the model."""
        digest, folder = sha256(), self._folders[name]
        for file in (*_state_files(folder), folder / "model.xml.gz", folder / "model.xml"):
            if file.is_file():
                digest.update(file.read_bytes())
        return digest.hexdigest()[:16]

    def read(self, name: str) -> Stored:
        """One episode."""
        folder = self._folders[name]
        parts, about = [], dict(_table(_bytes(folder.parent / "dataset_meta.json")))
        successful = None
        for part in _state_files(folder):
            arrays = npz_arrays(part, ("states", "env", "successful"))
            parts += [arrays["states"]] if "states" in arrays else []
            if "env" in arrays:
                about.setdefault("env", str(arrays["env"]))
            if "successful" in arrays:
                successful = bool(np.any(arrays["successful"])) or bool(successful)
        widths = {rows.shape[1:] for rows in parts}
        if len(widths) > 1:
            raise InputError(
                str(folder), f"its parts have rows of different widths: {sorted(widths)}."
            )
        return Stored(
            where=str(folder),
            model=_model((folder / "model.xml.gz", folder / "model.xml")),
            states=np.concatenate(parts) if parts else None,
            meta=_table(_bytes(folder / "ep_meta.json")),
            about=about,
            successful=successful,
            index=_number(folder.name),
        )


class StateArrays(Store):
    """One ``.npz`` file with its model."""

    def __init__(self, path: Path) -> None:
        """Read the arrays. Raises SourceError when they do not belong together."""
        self._path = path
        optional = ("time", "dt", "action", "ctrl", "success", "mujoco_version")
        self._arrays = npz_arrays(path, ("qpos", "qvel", *optional))
        qpos, qvel = self._arrays["qpos"], self._arrays["qvel"]
        if qpos.ndim not in (2, 3) or qvel.ndim != qpos.ndim or qpos.shape[:-1] != qvel.shape[:-1]:
            raise SourceError(
                str(path), f"qpos has the shape {qpos.shape} and qvel {qvel.shape}.",
                "(T, nq) and (T, nv), or (N, T, nq) and (N, T, nv) of N environments",
            )  # fmt: skip
        self._many = qpos.ndim == 3

    @classmethod
    def told_by(cls, path: Path) -> str | None:
        """By its arrays."""
        named = path.suffix.lower() == ".npz" and path.is_file()
        return "qpos and qvel" if named and npz_names(path) >= {"qpos", "qvel"} else None

    def names(self) -> list[str]:
        """``env_0`` … of many environments, else ``states``."""
        return [f"env_{i}" for i in range(len(self._arrays["qpos"]))] if self._many else ["states"]

    def fingerprint(self, name: str) -> str:
        """Of the states and the model."""
        digest = sha256(self._text().encode())
        for key in ("qpos", "qvel"):
            digest.update(np.ascontiguousarray(self._part(key, name)).tobytes())
        return digest.hexdigest()[:16]

    def read(self, name: str) -> Stored:
        """One episode."""
        qpos, qvel, time = (self._part(key, name) for key in ("qpos", "qvel", "time"))
        if time is not None and time.shape != (len(qpos),):
            raise SourceError(
                str(self._path), f"time has the shape {time.shape}.", f"({len(qpos)},)"
            )
        clock = np.arange(len(qpos), dtype=np.float64) if time is None else time
        version, dt = self._arrays.get("mujoco_version"), self._arrays.get("dt")
        about: dict[str, Any] = {} if version is None else {"mujoco_version": str(version)}
        if dt is not None and dt.size == 1 and float(dt.ravel()[0]) > 0:
            about["env_info"] = {"control_freq": 1 / float(dt.ravel()[0])}
        action, ctrl, success = (self._part(key, name) for key in ("action", "ctrl", "success"))
        return Stored(
            where=f"{self._path}:{name}",
            model=self._text(),
            states=np.column_stack([clock, qpos, qvel]),
            actions=_rows(ctrl if action is None else action),
            ctrl=_rows(ctrl),
            about=about,
            index=_number(name) if self._many else None,
            successful=None if success is None else bool(np.any(success)),
            clocked=time is not None,
        )

    def _part(self, key: str, name: str) -> Any:
        values = self._arrays.get(key)
        if values is None:
            return None
        own = self._many and (values.ndim > 1 or key == "success")
        return np.atleast_1d(values[int(name.removeprefix("env_"))] if own else values)

    def _text(self) -> str:
        text = _model((self._path.with_suffix(".xml"), self._path.with_name("model.xml")))
        if text is None:
            raise SourceError(
                str(self._path), "has states, but there is no model to put them into.",
                fix=f"the MJCF as {self._path.stem}.xml or model.xml beside it, in one piece "
                "(mj_saveLastXML writes it)",
            )  # fmt: skip
        return text


STORES: tuple[type[Store], ...] = (DemoFile, StateFolders, StateArrays)


def _episode_folders(path: Path) -> list[Path]:
    """Those with stored states below a dataset's folder, its ``extras``, or of a single episode."""
    if _state_files(path):
        return [path]
    for folder in (path / "extras", path):
        result = sorted(file.parent for file in folder.glob("episode_*/states.npz"))
        result = result or sorted(filter(_state_files, folder.glob("ep_*")), key=_moment)
        if result:
            return result
    return []


def _state_files(folder: Path) -> list[Path]:
    """RoboCasa's single file, or those that robosuite's collector wrote one after the other."""
    whole = folder / "states.npz"
    return [whole] if whole.is_file() else sorted(folder.glob("state_[0-9]*.npz"), key=_moment)


def _moment(path: Path) -> tuple[float, str]:
    """The time in ``state_1700000000_25``, as robosuite writes ``time.time()``."""
    match = re.search(r"(\d+)_(\d+)$", path.stem)
    return (float(f"{match[1]}.{match[2]}") if match else 0.0), path.stem


def _model(files: tuple[Path, ...]) -> str | None:
    """The text of the first of some files that is there, which may be packed. Raises InputError."""
    file = next((file for file in files if file.is_file()), None)
    if file is None:
        return None
    try:
        with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as stream:
            text = stream.read(LARGEST + 1).decode("utf-8")
        if len(text) > LARGEST:
            raise ValueError("more than 256 MiB of text")
    except (OSError, EOFError, zlib.error, ValueError) as error:
        raise InputError(str(file), f"cannot be read: {error}") from None
    return text


def _rows(values: NDArray[Any] | None) -> NDArray[Any]:
    """(T, A); A is 0 where there are none."""
    return values if values is not None and values.ndim == 2 else np.zeros((0, 0))


def _number(name: str) -> int | None:
    digits = re.search(r"(\d+)$", name)
    return int(digits[1]) if digits else None


def _text(value: Any) -> str | None:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return value if isinstance(value, str) else None


def _bytes(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError:
        return b""


def _table(value: Any) -> Mapping[str, Any]:
    """A mapping, or one in JSON; an empty one for anything else."""
    if isinstance(value, bytes | str):
        try:
            value = from_json(value, foreign=True)
        except ValueError:
            return {}
    return value if isinstance(value, Mapping) else {}
