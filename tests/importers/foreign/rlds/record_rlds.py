"""Writes the dataset beside it with TensorFlow Datasets' own writer.

In an environment of its own (``pip install tensorflow-cpu tensorflow-datasets``; written with 4.9.10):

    python tests/importers/foreign/rlds/record_rlds.py FOLDER

A cube slides along x: two episodes of 8 and 9 steps in ``train``, by 0.1 and 0.2 m, one of 8 steps in ``val``.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import tensorflow_datasets as tfds

F = tfds.features


class SimSet(tfds.core.GeneratorBasedBuilder):
    """Episodes with the pose of a cube in every step."""

    VERSION = tfds.core.Version("1.0.0")

    def _info(self) -> Any:
        flags = {name: F.Scalar(dtype=np.bool_) for name in ("is_first", "is_last", "is_terminal")}
        observation = {
            "image": F.Image(shape=(4, 4, 3), encoding_format="jpeg"),
            "state": F.Tensor(shape=(7,), dtype=np.float32),
            "cube_pose": F.Tensor(shape=(7,), dtype=np.float64),
            "pair": F.Tensor(shape=(2, 3), dtype=np.float32),
        }
        steps = {
            "observation": F.FeaturesDict(observation),
            "action": F.Tensor(shape=(7,), dtype=np.float32),
            "reward": F.Scalar(dtype=np.float32),
            "language_instruction": F.Text(),
            **flags,
        }
        about = F.FeaturesDict({"file_path": F.Text()})
        whole = F.FeaturesDict({"steps": F.Dataset(steps), "episode_metadata": about})
        return tfds.core.DatasetInfo(builder=self, features=whole)

    def _split_generators(self, _: Any) -> dict[str, Any]:
        return {"train": self._generate_examples(2), "val": self._generate_examples(1)}

    def _generate_examples(self, count: int) -> Iterator[tuple[str, Any]]:
        for i in range(count):
            number = 8 + i
            steps = [
                {
                    "observation": {
                        "image": np.random.default_rng(k).integers(0, 255, (4, 4, 3), np.uint8),
                        "state": np.zeros(7, np.float32),
                        "cube_pose": np.array([x, 0, 0.02, 0, 0, 0, 1]),
                        "pair": np.full((2, 3), k, np.float32),
                    },
                    "action": np.zeros(7, np.float32),
                    "reward": float(k == number - 2),
                    "is_first": k == 0,
                    "is_last": k == number - 1,
                    "is_terminal": k == number - 1,
                    "language_instruction": "push the cube",
                }
                for k, x in enumerate(np.linspace(0, 0.1 * (i + 1), number))
            ]
            yield f"e{i}", {"steps": steps, "episode_metadata": {"file_path": f"/x/{i}"}}


if __name__ == "__main__":
    SimSet(data_dir=sys.argv[1]).download_and_prepare()
