"""A trained network as an ONNX file, run by onnxruntime."""

from __future__ import annotations

import importlib.util
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError

FOLDER = Path(__file__).parent / "checkpoints"
ABOUT = "safestage"
"""Key of the file's metadata under which stands what acting needs to know, as JSON."""
INPUTS = ("arm", "objects", "start", "prompt", "clock", "noise")


def shipped() -> tuple[str, ...]:
    """Names of the checkpoints in this package: the shipped one, and what `make learned` trained."""
    return tuple(path.stem for path in sorted(FOLDER.glob("*.onnx")))


def checkpoint_file(name: str) -> Path:
    """The file of a shipped checkpoint, or of a path. Raises InputError for what is neither."""
    path = FOLDER / f"{name}.onnx" if name in shipped() else Path(name)
    if path.suffix != ".onnx" or not path.is_file():
        raise InputError(
            f"policy 'learned:{name}'", "no such checkpoint.",
            ", ".join([*shipped(), "the path of an .onnx file"]),
            "`make learned` trains those of docs/learned_policies.md",
        )  # fmt: skip
    return path


class Checkpoint:
    """A network that acts."""

    def __init__(self, path: Path) -> None:
        """Load it. Raises InputError without onnxruntime, and for a file that is no checkpoint."""
        if importlib.util.find_spec("onnxruntime") is None:
            raise InputError(
                f"policy 'learned:{path}'", "needs onnxruntime, which is not installed.",
                fix="pip install 'safestage[learn]'",
            )  # fmt: skip
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(
                str(path), options, providers=["CPUExecutionProvider"]
            )
            text = self._session.get_modelmeta().custom_metadata_map[ABOUT]
            self.about: dict[str, Any] = json.loads(text)
            self.play, self.noise = int(self.about["play"]), int(self.about["noise"])
        except Exception as error:  # noqa: BLE001 - onnxruntime's errors have no common ancestor of their own
            raise InputError(
                str(path), f"no checkpoint of `safestage bench learn train`: {error}"
            ) from None
        self._wanted = {each.name for each in self._session.get_inputs()}
        if not self._wanted <= {*INPUTS}:
            raise InputError(
                str(path), "acts on pictures, which checkpoints no longer do.",
                fix="serve it, or write it as a policy of your own with cameras (docs/policies.md)",
            )  # fmt: skip

    def answer(self, **inputs: NDArray[Any]) -> NDArray[np.float32]:
        """(chunk, ANSWER) of one observation's inputs, each with a first axis of 1."""
        given = {name: value for name, value in inputs.items() if name in self._wanted}
        (result,) = self._session.run(["answer"], given)
        return np.asarray(result[0], np.float32)


@cache
def opened(name: str) -> Checkpoint:
    """A checkpoint, loaded once per process."""
    return Checkpoint(checkpoint_file(name))
