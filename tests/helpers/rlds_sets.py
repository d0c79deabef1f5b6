"""RLDS datasets as TensorFlow Datasets writes them, byte by byte and without its code."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from exports import RIGID, pose

from safestage_eval.episode import Episode

FEATURES = "tensorflow_datasets.core.features"


def crc32c(data: bytes) -> int:
    """Bit by bit, by its definition."""
    register = 0xFFFFFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0x82F63B78 if register & 1 else 0)
    return register ^ 0xFFFFFFFF


def masked(data: bytes, crc32c: Callable[[bytes], int] = crc32c) -> bytes:
    """The checksum that stands in a file."""
    crc = crc32c(data)
    return struct.pack("<I", ((crc >> 15 | crc << 17) + 0xA282EAD8) & 0xFFFFFFFF)


def record(data: bytes, crc32c: Callable[[bytes], int] = crc32c) -> bytes:
    """A record with its frame; ``crc32c`` may be a faster one."""
    head = struct.pack("<Q", len(data))
    return head + masked(head, crc32c) + data + masked(data, crc32c)


def varint(number: int) -> bytes:
    """Seven bits a byte, the lowest first."""
    number &= (1 << 64) - 1
    out = b""
    while number > 0x7F:
        out += bytes([number & 0x7F | 0x80])
        number >>= 7
    return out + bytes([number])


def field(number: int, data: bytes) -> bytes:
    """A field of bytes, or of a message."""
    return varint(number << 3 | 2) + varint(len(data)) + data


def feature(values: Any) -> bytes:
    """A ``Feature``: floats packed, whole numbers and truths packed, texts one by one."""
    values = np.asarray(values).ravel()
    if values.dtype.kind == "f":
        return field(2, field(1, values.astype("<f4").tobytes()))
    if values.dtype.kind in "iub":
        return field(3, field(1, b"".join(varint(int(v)) for v in values)))
    return field(1, b"".join(field(1, str(v).encode()) for v in values))


def example(features: dict[str, Any]) -> bytes:
    """A ``tf.train.Example``."""
    entries = (field(1, field(1, k.encode()) + field(2, feature(v))) for k, v in features.items())
    return field(1, b"".join(entries))


def steps_of(episode: Episode) -> dict[str, Any]:
    """Columns of an episode's steps: poses as xyzw, twists, and what Open X-Embodiment has besides."""
    names = [body.name for body in episode.header.bodies if body.kind in RIGID]
    twists = [
        getattr(episode.track(name), f"{kind}_velocity")
        for name in names
        for kind in ("linear", "angular")
    ]
    last = np.arange(len(episode)) == len(episode) - 1
    return {
        "observation/sim_state": np.hstack([pose(episode, name, "xyzw") for name in names]),
        "observation/twists": np.hstack(twists).astype(np.float32),
        "action": np.zeros((len(episode), 7), np.float32),
        "discount": np.ones(len(episode), np.float32),
        "is_first": np.arange(len(episode)) == 0,
        "is_last": last,
        "language_instruction": np.full(len(episode), "do it"),
    }


def spec(values: np.ndarray) -> dict[str, Any]:
    """Columns of ``features.json``."""
    if values.dtype.kind == "U":
        return {"pythonClassName": f"{FEATURES}.text_feature.Text", "text": {}}
    shape = {"dimensions": [str(n) for n in values.shape[1:]]} if values.ndim > 1 else {}
    kind = "bool" if values.dtype.kind == "b" else str(values.dtype)
    tensor = {"shape": shape, "dtype": kind, "encoding": "none"}
    name = "tensor_feature.Tensor" if shape else "scalar.Scalar"
    return {"pythonClassName": f"{FEATURES}.{name}", "tensor": tensor}


def features_dict(columns: dict[str, Any]) -> dict[str, Any]:
    """Nested by the slashes in the names."""
    inner: dict[str, Any] = {}
    for name, value in columns.items():
        first, _, rest = name.partition("/")
        if rest:
            inner.setdefault(first, {})[rest] = value
        else:
            inner[first] = value
    values = {k: features_dict(v) if isinstance(v, dict) else spec(v) for k, v in inner.items()}
    return {
        "pythonClassName": f"{FEATURES}.features_dict.FeaturesDict",
        "featuresDict": {"features": values},
    }


def write_rlds(
    folder: Path, episodes: list[Episode], *, shards: int = 1, name: str = "sim_set"
) -> tuple[Path, str]:
    """The folder of the dataset's version, and the ``[columns]`` of its map file."""
    folder = folder / name / "1.0.0"
    folder.mkdir(parents=True)
    parts = np.array_split(np.arange(len(episodes)), shards)
    for number, part in enumerate(parts):
        records = []
        for i in part:
            columns = {f"steps/{key}": value for key, value in steps_of(episodes[i]).items()}
            columns["episode_metadata/file_path"] = np.array([f"/data/{i}.h5"])
            records.append(record(example(columns)))
        file = folder / f"{name}-train.tfrecord-{number:05d}-of-{shards:05d}"
        file.write_bytes(b"".join(records))
    split = {
        "filepathTemplate": "{DATASET}-{SPLIT}.{FILEFORMAT}-{SHARD_X_OF_Y}",
        "name": "train",
        "shardLengths": [str(len(part)) for part in parts],
    }
    info = {"fileFormat": "tfrecord", "name": name, "splits": [split], "version": "1.0.0"}
    (folder / "dataset_info.json").write_text(json.dumps(info))
    inner = features_dict(steps_of(episodes[0]))
    steps = {
        "pythonClassName": f"{FEATURES}.dataset_feature.Dataset",
        "sequence": {"feature": inner, "length": "-1"},
    }
    about = features_dict({"file_path": np.array(["x"])})
    whole = {"featuresDict": {"features": {"steps": steps, "episode_metadata": about}}}
    (folder / "features.json").write_text(json.dumps(whole))
    return folder, columns_text(episodes[0])


def columns_text(episode: Episode) -> str:
    """``[columns]`` and ``[source]`` of a map file for the columns of ``steps_of``."""
    lines = []
    for i, name in enumerate(body.name for body in episode.header.bodies if body.kind in RIGID):
        parts = {
            "position": f"sim_state[{7 * i}:{7 * i + 3}]",
            "orientation": f"sim_state[{7 * i + 3}:{7 * i + 7}]",
            "linear_velocity": f"twists[{6 * i}:{6 * i + 3}]",
            "angular_velocity": f"twists[{6 * i + 3}:{6 * i + 6}]",
        }
        lines += [
            f'[columns.body."{name}"]',
            *(f'{k} = "observation/{v}"' for k, v in parts.items()),
        ]
    return "\n".join([*lines, "[source]", 'quaternion = "xyzw"', f"dt = {episode.dt!r}", ""])
