"""Known formats without poses of objects: refused, with what to ask the publisher for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from . import hdf5
from .importer import Refused, SourceError

RECORD = "are recorded whole by safestage-record (docs/record_anywhere.md)"


def ask_for(source: str) -> str:
    """Return what to ask the publisher of a dataset for, by its name."""
    name = source.lower()
    if "droid" in name:
        return (
            "DROID was recorded on real robots, and where objects were was never measured; poses "
            "from an object tracker would have to be added, as columns of their own. Rollouts in a "
            f"simulator {RECORD}"
        )
    if "aloha" in name:
        return (
            "ALOHA's episodes have joints and images, and never where objects were; simulated ones "
            f"{RECORD}; real ones need the poses of an object tracker, as columns of their own"
        )
    simulated = {
        "libero": "the original HDF5 files of LIBERO, which have data/demo_i/states",
        "robocasa": "RoboCasa's extras/episode_*/states.npz, or its HDF5 files with states",
        "robomimic": "robomimic's HDF5 files with states (demo_v15.hdf5, not image_v15.hdf5)",
        "mimicgen": "MimicGen's HDF5 files, which have data/demo_i/states",
        "maniskill": "ManiSkill's .h5 and .json files, which have env_states",
        "robolab": "RoboLab's run_*.hdf5, which have data/demo_i/states",
    }
    for suite, files in simulated.items():
        if suite in name:
            return (
                f"ask the publisher for {files}; the conversion dropped them. Own rollouts {RECORD}"
            )
    return (
        "ask the publisher for the simulator's states (positions and orientations of every object "
        "per step, with shapes or model files); of a real robot, as most of Open X-Embodiment, for an "
        f"object tracker's poses. Rollouts that still run in a simulator {RECORD}"
    )


class Stateless(Refused):
    """Raw DROID, ALOHA, and HDF5 with observations only."""

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By HDF5 groups without states."""
        if not hdf5.is_hdf5(path):
            return None
        with hdf5.open_hdf5(path) as file:
            if {"observations", "action"} <= set(file) and "qpos" in file["observations"]:
                return "ALOHA: HDF5 with observations/qpos and action"
            if "observation/robot_state" in file:
                return "raw DROID: HDF5 with observation/robot_state"
            demos = file.get("data")
            if demos is None or not hasattr(demos, "keys"):
                return None
            first = next((demos[n] for n in demos if hasattr(demos[n], "keys")), None)
            if first is not None and "states" not in first and {"obs", "actions"} & set(first):
                return f"HDF5 with {first.name[1:]}, without states"
        return None

    @classmethod
    def refusal(cls, path: Path) -> SourceError:
        """Return the error that there are no poses, and who may have them."""
        seen = _seen(path)
        return SourceError(
            str(path),
            "has no poses of objects, only what the robot saw and did"
            + (f" ({', '.join(seen[:8])})." if seen else "."),
            fix=ask_for(f"{path} {' '.join(seen)} {_description(path)}"),
        )


def _description(path: Path) -> str:
    with hdf5.open_hdf5(path) as file:
        if "observation/robot_state" in file:
            return "droid"
        if "observations" in file:
            return "aloha"
        args = file["data"].attrs.get("env_args", "") if "data" in file else ""
        return str(args)


def _seen(path: Path) -> list[str]:
    """Names of what is recorded."""
    with hdf5.open_hdf5(path) as file:
        return list(dict.fromkeys(n.split("/")[-1] for n, _ in hdf5.datasets(_first(file))))


def _first(file: Any) -> Any:
    if "data" not in file:
        return file
    return file["data"][hdf5.numbered(file["data"])[0]]
