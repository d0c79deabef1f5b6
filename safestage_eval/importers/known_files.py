"""Names files that cannot be imported: what each is, what it lacks, what to do. One table of signatures."""

from __future__ import annotations

import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safestage_eval.formats.discover import MCAP_MAGIC

from . import hdf5
from .bag_files import topics
from .importer import Refused, SourceError

RECORD = "are recorded whole by safestage-record (docs/record_anywhere.md)"

MOST = 2000
"""Files of a folder that are looked at to say what it holds."""


@dataclass(frozen=True)
class Known:
    """A kind of file that cannot be imported; the fields are the parts of its message."""

    name: str
    lacks: str
    fix: str

    def error(self, path: Path, more: str = "") -> SourceError:
        """Return the error about one file; ``more`` follows its name."""
        return SourceError(str(path), f"{self.name}: {self.lacks}{more}.", fix=self.fix)


LFS = Known(
    "a pointer of Git LFS, not the file itself",
    "the data were not downloaded",
    "git lfs pull in the repository that it is from, or download the file by its page",
)
RECORDINGS = {".hdf5", ".h5", ".mcap", ".db3", ".bag", ".npz", ".parquet", ".rrd", ".zip"}
MAGICS: tuple[tuple[bytes, Known], ...] = (
    (b"version https://git-lfs.github.com/spec/", LFS),
    (
        b"RRF",
        Known(
            "a Rerun recording (.rrd)",
            "it is made to be looked at, and has no fixed names for bodies, shapes and time",
            "import what it was made from (a bag, a dataset or a simulator's states); rollouts that "
            f"still run {RECORD}",
        ),
    ),
    (
        b"ULog\x01\x12\x35",
        Known(
            "a flight log of PX4 (ULog)",
            "it has the vehicle's state, and nothing of objects around it",
            "nothing in it can be judged: SafeStage judges what robots do to objects",
        ),
    ),
)
"""First bytes → what such a file is."""

PRUNED_INIT = Known(
    "initial states of LIBERO (.pruned_init, a file of PyTorch)",
    "it has the states at which episodes begin, and no motion",
    "import demonstrations of the task (LIBERO's *_demo.hdf5), or the rollouts that began there: they "
    + RECORD,
)
NPZ = Known(
    "a NumPy archive (.npz)",
    "its arrays have names that nothing here knows",
    "a folder with states.npz and model.xml.gz, CALVIN's folder of episode_*.npz, or one archive "
    "with qpos, qvel and model is read; make a table with a column per number and a map file "
    "otherwise (docs/import/map.md)",
)
ROBOHIVE = Known(
    "HDF5 of RoboHive (Trial0/time, Trial0/env_infos)",
    "states of the simulator are in it, but no model to put them into",
    "store [time, qpos, qvel] as states.npz beside model.xml.gz, the environment's MJCF with its "
    "meshes (docs/import/mujoco.md)",
)
OMNIGIBSON = Known(
    "HDF5 of OmniGibson (BEHAVIOR)",
    "its states are one row of numbers per step that only OmniGibson can take apart, and shapes are "
    "in the assets of BEHAVIOR",
    f"replay the episode in OmniGibson with the recorder attached: such rollouts {RECORD}",
)
NO_DEMOS = Known(
    "HDF5 of demonstrations (data/…)",
    "there is no demonstration in it",
    "check that the recording came to its end; or that the download is whole",
)
OTHER_HDF5 = Known(
    "an HDF5 file",
    "it has no layout that is known here",
    "if it has a pose (position and quaternion) per object and row, make a LeRobot dataset or a table "
    f"of it and name the columns in a map file (docs/import/map.md); rollouts that still run {RECORD}",
)
NO_POSES = Known(
    "an MCAP file",
    "it has no transforms, so that nothing tells where objects are",
    "record /tf and /tf_static (or foxglove.FrameTransform) with the poses of objects, of a tracker "
    "or of the simulator",
)
MODEL_BY_NAME = Known(
    "demonstrations of MuJoCo states whose model is the name of a file",
    "the model itself (MJCF) is not in the file, as in those of robosuite 0.x and of some releases "
    "of RoboCasa",
    "put the text of that file into the attribute model_file of each demonstration, or take the "
    "dataset that its collector wrote",
)


def _joint_only(path: Path, file: Any) -> Known | None:
    """ALOHA, raw DROID, and demonstrations with observations only."""
    group = file
    if {"observations", "action"} <= set(file) and "qpos" in file["observations"]:
        name, text = "ALOHA: HDF5 with observations/qpos and action", "aloha"
    elif "observation/robot_state" in file:
        name, text = "raw DROID: HDF5 with observation/robot_state", "droid"
    else:
        demos = [d for d in hdf5.demos(file) if {"obs", "actions"} & set(d)]
        if not demos or "states" in demos[0]:
            return None
        group = demos[0]
        name, text = f"HDF5 with {group.name[1:]}, without states", str(_args(file))
    seen = list(dict.fromkeys(n.split("/")[-1] for n, _ in hdf5.datasets(group)))
    lacks = "has no poses of objects, only what the robot saw and did"
    lacks += f" ({', '.join(seen[:8])})" if seen else ""
    return Known(name, lacks, ask_for(f"{path} {' '.join(seen)} {text}"))


def _args(file: Any) -> object:
    return file["data"].attrs.get("env_args", "") if "data" in file else ""


def in_hdf5(path: Path) -> Known | None:
    """The kind of an HDF5 file. Raises SourceError when it is damaged."""
    with hdf5.open_hdf5(path) as file, hdf5.layout(str(path)):
        demos = hdf5.demos(file)
        if "Trial0" in file and "env_infos" in file["Trial0"]:
            return ROBOHIVE
        if "scene_file" in file.get("data", file).attrs or (demos and "state_size" in demos[0]):
            return OMNIGIBSON
        model = demos[0].attrs.get("model_file", "") if demos else ""
        text = model.decode("utf-8", "replace") if isinstance(model, bytes) else str(model)
        if text and not text.lstrip().startswith("<"):
            return MODEL_BY_NAME
        known = _joint_only(path, file)
        if known is not None:
            return known
        if hasattr(file.get("data"), "keys") and not demos:
            return NO_DEMOS
        if demos and ("states" in demos[0] or text):
            return None
        return OTHER_HDF5


def in_mcap(path: Path) -> Known | None:
    """An MCAP file that has no transforms, with its topics; None of a trace or a damaged file."""
    found = [f"{topic} ({kind})" for topic, kind in topics(path).items()]
    if not found:
        return None
    listed = ", ".join(sorted(found)[:20])
    return Known(NO_POSES.name, f"{NO_POSES.lacks}; its topics: {listed}", NO_POSES.fix)


def _torch_or_npz(path: Path) -> Known | None:
    if path.suffix == ".pruned_init":
        return PRUNED_INIT
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        return None
    arrays = [name.removesuffix(".npy") for name in names if name.endswith(".npy")]
    if not arrays or len(arrays) != len(names):
        return None
    return Known(NPZ.name, f"{NPZ.lacks} ({', '.join(arrays[:8])})", NPZ.fix)


INSIDE: tuple[tuple[bytes, Callable[[Path], Known | None]], ...] = (
    (hdf5.MAGIC, in_hdf5),
    (MCAP_MAGIC, in_mcap),
    (b"PK\x03\x04", _torch_or_npz),
    (b"\x80", lambda path: PRUNED_INIT if path.suffix == ".pruned_init" else None),
)
"""First bytes → a look inside."""


def known(path: Path) -> Known | None:
    """Say what a file is; None if nothing is known of it. Asked when no importer takes it.

    Raises:
        SourceError: it is damaged, or what reads it is not installed.
    """
    try:
        with path.open("rb") as stream:
            begin = stream.read(64)
    except OSError:
        return None
    for magic, what in MAGICS:
        if begin.startswith(magic):
            return what
    return next((look(path) for magic, look in INSIDE if begin.startswith(magic)), None)


def described(source: Path) -> SourceError | None:
    """Say what a file, or most of the files of a folder, are; None if nothing is known of them."""
    found: Counter[str] = Counter()
    first: dict[str, tuple[Path, Known]] = {}
    for path in _files(source):
        try:
            what = known(path)
        except SourceError:
            continue
        if what is not None:
            found[what.name] += 1
            first.setdefault(what.name, (path, what))
    if not found:
        return None
    (name, count), *others = found.most_common()
    more = f". So {'is' if count == 2 else 'are'} {count - 1} more" if count > 1 else ""
    more += "".join(f"; {n} × {other}" for other, n in others)
    path, what = first[name]
    return what.error(path, more)


def _files(source: Path) -> Iterator[Path]:
    if source.is_file():
        yield source
        return
    paths = (p for p in sorted(source.rglob("*")) if p.is_file() and not p.name.startswith("."))
    for path, _ in zip(paths, range(MOST), strict=False):
        yield path


class Unusable(Refused):
    """Files that are recordings for certain, and lack what no trace can do without."""

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By the table; archives and unknown HDF5 among other files are left alone."""
        if not path.is_file():
            return None
        what = known(path)
        if what is None or what is OTHER_HDF5 or what.name == NPZ.name:
            return None
        if what is LFS and path.suffix not in RECORDINGS:
            return None  # a picture or a mesh
        return what.name

    @classmethod
    def refusal(cls, path: Path) -> SourceError:
        """Return the error with what the file is and lacks, and what to do."""
        what = known(path)
        assert what is not None
        return what.error(path)


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
