"""Contacts of stored states, computed by the MuJoCo that recorded them, in an interpreter of its own."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import IO, Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from safestage_eval.formats import CONTACT_POINT
from safestage_eval.importers.importer import SourceError

from .forward_pass import contacts
from .model_file import Loaded

F64 = NDArray[np.float64]
SCRIPT = Path(__file__).with_name("forward_pass.py")
FLAG = "--python"


@dataclass(frozen=True)
class Touches:
    """The contacts of an episode.

    Attributes:
        version: of the MuJoCo that computed them.
        points: by frame, with the geoms numbered as in the model.
    """

    version: str
    points: list[NDArray[np.void]]


class States(NamedTuple):
    """The rows of an episode.

    Attributes:
        time: (T,) s.
        qpos: (T, nq).
        qvel: (T, nv).
        ctrl: (T, nu) of the actuators, in force from each row on; (T, 0) where it is not stored.
    """

    time: F64
    qpos: F64
    qvel: F64
    ctrl: F64


def touches_here(model: mujoco.MjModel, states: States, driven: NDArray[np.intp]) -> Touches:
    """Contacts of the states as this interpreter's MuJoCo computes them."""
    return Touches(
        mujoco.__version__,
        _by_frame(contacts(model, *states, driven), model, len(states.time)),
    )


class RecorderMujoco:
    """An interpreter with the recorder's MuJoCo, running from the first question until it is closed."""

    def __init__(self, python: Path) -> None:
        """``python``: the interpreter; it is started when it is first asked."""
        self._python = python
        self._process: subprocess.Popen[str] | None = None
        self._errors: IO[str] | None = None

    def close(self) -> None:
        """End the interpreter."""
        if self._process is not None:
            for stream in (self._process.stdin, self._process.stdout):
                if stream is not None:
                    stream.close()
            self._process.terminate()
            self._process.wait()
        if self._errors is not None:
            self._errors.close()
        self._process = self._errors = None

    def touches(
        self, loaded: Loaded, states: States, driven: NDArray[np.intp], where: str
    ) -> Touches:
        """Contacts of the states, by forward passes over each.

        ``driven``: degrees of freedom of robots.

        Raises:
            SourceError: the interpreter has no MuJoCo, or one that cannot read the model.
        """
        model = loaded.model
        with tempfile.TemporaryDirectory(prefix="safestage-import-") as folder:
            source, target = Path(folder, "in.npz"), Path(folder, "out.npz")
            assets: dict[str, Any] = {f"asset_{i}": np.frombuffer(content, np.uint8)
                      for i, content in enumerate(loaded.assets.values())}  # fmt: skip
            np.savez(
                source, xml=loaded.xml, asset_names=np.array(list(loaded.assets), str),
                mass=model.body_mass, inertia=model.body_inertia, centre=model.body_ipos,
                turn=model.body_iquat, **states._asdict(), driven=driven, **assets,
            )  # fmt: skip
            self._ask(source, target, where)
            with np.load(target, allow_pickle=False) as archive:
                sizes = (model.nq, model.nv, model.nbody, model.ngeom)
                if tuple(archive["sizes"].tolist()) != sizes:
                    raise self._unusable(where, "it reads another model out of the same file")
                return Touches(str(archive["version"]), _by_frame(archive, model, len(states.time)))

    def _ask(self, source: Path, target: Path, where: str) -> None:
        if self._process is None:
            self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 — closed with the process
            try:
                self._process = subprocess.Popen(  # noqa: S603 — the user's own
                    [str(self._python), "-I", str(SCRIPT)], stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE, stderr=self._errors, text=True,
                )  # fmt: skip
            except OSError as error:
                self.close()
                raise self._unusable(where, f"it cannot be started: {error.strerror}") from None
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(f"{source}\t{target}\n")
            process.stdin.flush()
            answer = process.stdout.readline().strip()
        except BrokenPipeError:
            answer = ""
        if not answer:
            said = self._last_words(process)
            self.close()
            raise self._unusable(where, said[-1] if said else "it ended without an answer")
        if answer != "ok":
            raise self._unusable(where, answer)

    def _last_words(self, process: subprocess.Popen[str]) -> list[str]:
        """Lines that an interpreter which has ended wrote as errors."""
        process.wait()
        assert self._errors is not None
        self._errors.seek(0)
        return self._errors.read().strip().splitlines()

    def _unusable(self, where: str, why: str) -> SourceError:
        return SourceError(
            where,
            f"its contacts cannot be computed with {self._python}: {why}.",
            fix=f"{FLAG} PATH of a Python that has the mujoco of the recording (2.3 or later) and numpy; "
            f"without {FLAG} forces on the robot stay unknown",
        )


def _by_frame(
    told: Mapping[str, NDArray[Any]], model: mujoco.MjModel, frames: int
) -> list[NDArray[np.void]]:
    """Contact points of each frame, whole forces in the world, geoms numbered as in the model.

    The peak force of a pair of bodies is what it presses with at the frame.
    """
    frame, geom = told["frame"], told["geom"]
    points = np.zeros(len(frame), CONTACT_POINT)
    axes: F64 = told["axes"]
    points["position"], points["normal"] = told["position"], axes[:, 0]
    points["force"] = np.einsum("ck,ckx->cx", told["force"], axes)
    points["depth"] = -told["distance"]
    points["geom1"], points["geom2"] = geom.T
    pair = np.sort(model.geom_bodyid[geom], axis=1)
    _, which = np.unique(np.column_stack([frame, pair]), axis=0, return_inverse=True)
    which = which.ravel()
    points["peak_force"] = np.bincount(which, told["force"][:, 0])[which]
    edges = np.searchsorted(frame, np.arange(frames + 1))
    return [points[a:b] for a, b in pairwise(edges.tolist())]


def pushed_by_robot(
    points: NDArray[np.void], model: mujoco.MjModel, robot: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which contacts of a frame the robot's unknown forces reach, through whatever it presses on.

    Args:
        points: (C,) contacts, geoms numbered as in the model.
        model: of the scene.
        robot: (nbody,) parts of a robot.

    Returns:
        (C,) of the robot itself, and of every body that moves and hangs together with it by contacts.
    """
    first, second = (model.geom_bodyid[points[key]] for key in ("geom1", "geom2"))
    moves = model.body_weldid != 0
    reached = robot.copy()
    while True:
        open_ = (reached[first] | reached[second]) & moves[first] & moves[second]
        more = np.union1d(first[open_], second[open_])
        if reached[more].all():
            return np.asarray(reached[first] | reached[second])
        reached[more] = True
