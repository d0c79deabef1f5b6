"""RLDS: datasets of TensorFlow Datasets whose examples are episodes; the map file assigns their columns.

Facts that matter here (github.com/google-research/rlds; tensorflow/datasets, core/features, core/example_serializer):

- A folder has ``dataset_info.json`` (splits, and how many episodes each shard has), ``features.json`` and
  ``NAME-SPLIT.tfrecord-00000-of-00004``.
- An episode is one record. Its ``steps`` are stored column by column: ``steps/observation/state`` holds the
  numbers of all steps in a row, of as many dimensions as ``features.json`` says.
- Nothing says how much time lies between two steps.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import cached_property
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import TraceError
from safestage_eval.size_limits import current

from .column_episode import ColumnImporter, Rows
from .importer import Settings, SourceError, json_table
from .tfrecord import numbers, parse_example, read_record, record_places

F64 = NDArray[np.float64]

STEPS = "steps/"
INSTRUCTIONS = ("language_instruction", "observation/natural_language_instruction")
"""Columns that Open X-Embodiment has the instruction in."""
_SHARD = (
    r"(?P<name>.+)-(?P<split>[\w.]+)\.(?P<kind>tfrecord|array_record|riegeli)-(\d{5})-of-(\d{5})"
)


class Column(NamedTuple):
    """A column of ``features.json``: numbers per step (None without any), and whether it is encoded."""

    width: int | None
    encoded: bool


class Rlds(ColumnImporter):
    """One dataset folder, of one version."""

    name = "rlds"
    title = "RLDS dataset"

    def __init__(self, path: Path, settings: Settings) -> None:
        """Read the dataset's description.

        Raises:
            UnmappedError: no column map.
        """
        self._info = json_table(path / "dataset_info.json")
        self._table = columns(json_table(path / "features.json"))
        self.publisher = str(self._info.get("name", ""))
        super().__init__(path, settings)

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By ``features.json``, ``dataset_info.json`` and a feature ``steps``."""
        if not (path / "dataset_info.json").is_file():
            return None
        known = columns(json_table(path / "features.json"))
        return "RLDS: features.json has steps" if known else None

    def episodes(self) -> list[str]:
        """``train_0``, ``train_1``, … in the order of splits and shards."""
        return list(self._places)

    def seen(self) -> list[str]:
        """Columns of ``features.json``."""
        return list(self._table)

    def widths(self) -> dict[str, Sequence[str]]:
        """See ``ColumnImporter.widths``."""
        return {n: [""] * c.width for n, c in self._table.items() if c.width and not c.encoded}

    def rows(self, name: str, wanted: Sequence[str]) -> Rows:
        """See ``ColumnImporter.rows``."""
        if name not in self._places:
            raise TraceError(f"{self.path}: {name}", "there is no such episode.")
        file, place = self._places[name]
        where = f"{file}: {name}"
        known = {n: self._table[n] for n in wanted if n in self._table and self._table[n].width}
        encoded = [column for column, spec in known.items() if spec.encoded]
        if encoded:
            raise SourceError(
                where, f"column {encoded[0]!r} is stored in a compressed encoding.",
                fix='write the dataset with encoding="none"',
            )  # fmt: skip
        features = parse_example(read_record(file, place), where)
        found = {n: _values(features, n, spec.width or 1, where) for n, spec in known.items()}
        counts = {n: len(values) for n, values in found.items()}
        if len(set(counts.values())) > 1 or 0 in counts.values():
            listed = ", ".join(f"{n}: {count}" for n, count in counts.items())
            raise TraceError(
                where, f"its columns have different numbers of steps, or none ({listed})."
            )
        return Rows(found, int(name.rpartition("_")[2]), instruction=_instruction(features))

    @cached_property
    def _places(self) -> dict[str, tuple[Path, tuple[int, int]]]:
        """Episode → its file, and its place there."""
        shards = [(match, path) for path in sorted(self.path.iterdir())
                  if (match := re.fullmatch(_SHARD, path.name))]  # fmt: skip
        other = next((match["kind"] for match, _ in shards if match["kind"] != "tfrecord"), None)
        if other is not None:
            raise SourceError(
                str(self.path), f"its episodes are in {other} files, which are not read.", "tfrecord",
                "tfds convert_format --out_file_format=tfrecord",
            )  # fmt: skip
        result: dict[str, tuple[Path, tuple[int, int]]] = {}
        splits = _splits(self._info) or dict.fromkeys(match["split"] for match, _ in shards)
        for split, lengths in splits.items():
            mine = [path for match, path in shards if match["split"] == split]
            places = [record_places(path) for path in mine]
            if lengths is not None and [len(shard) for shard in places] != lengths:
                raise TraceError(
                    str(self.path),
                    f"the shards of {split!r} have {[len(shard) for shard in places]} episodes, "
                    f"and dataset_info.json says {lengths}.",
                    fix="download what is missing",
                )
            all_ = [(path, p) for path, shard in zip(mine, places, strict=True) for p in shard]
            result.update({f"{split}_{number}": place for number, place in enumerate(all_)})
        return result


def columns(features: Any) -> dict[str, Column]:
    """Columns of the steps in a ``features.json``, by names below ``steps/``."""
    return {n.removeprefix(STEPS): c for n, c in _leaves(features, "") if n.startswith(STEPS)}


def _leaves(spec: Any, name: str, depth: int = 0) -> Iterator[tuple[str, Column]]:
    if not isinstance(spec, dict) or depth > 32:
        return
    for key in ("sequence", "dataset"):
        if isinstance(spec.get(key), dict):
            yield from _leaves(spec[key].get("feature", spec[key]), name, depth + 1)
            return
    inner = spec.get("featuresDict")
    if isinstance(inner, dict) and isinstance(inner.get("features"), dict):
        for key, below in inner["features"].items():
            yield from _leaves(below, f"{name}/{key}" if name else str(key), depth + 1)
        return
    yield name, _column(spec)


def _column(spec: dict[str, Any]) -> Column:
    tensor = spec.get("tensor")
    if not isinstance(tensor, dict) or tensor.get("dtype") in (None, "string"):
        return Column(None, encoded=False)
    shape = tensor.get("shape")
    sizes = shape.get("dimensions", []) if isinstance(shape, dict) else []
    known = isinstance(sizes, list) and all(re.fullmatch(r"[1-9]\d{0,8}", str(n)) for n in sizes)
    encoded = str(tensor.get("encoding", "none")).lower() != "none"
    return Column(prod(int(n) for n in sizes) if known else None, encoded)


def _values(features: dict[str, Any], column: str, width: int, where: str) -> F64:
    """(T, k) of a column."""
    feature = features.get(STEPS + column)
    values = None if feature is None else numbers(feature)
    if values is None:
        raise TraceError(where, f"has no numbers in {column!r}, though features.json says so.")
    current().demand("frames", len(values) // width, where)
    if len(values) % width:
        raise TraceError(
            where, f"{column!r} has {len(values)} numbers.", f"a multiple of {width}, the numbers of a step"
        )  # fmt: skip
    return values.reshape(-1, width)


def _instruction(features: dict[str, Any]) -> str | None:
    """The instruction of the first step."""
    for column in INSTRUCTIONS:
        feature = features.get(STEPS + column)
        if feature is not None and len(feature.bytes_list.value):
            text: bytes = feature.bytes_list.value[0]
            current().demand("text", len(text), STEPS + column)
            return text.decode("utf-8", "replace") or None
    return None


def _splits(info: dict[str, Any]) -> dict[str, list[int] | None]:
    """Split → how many episodes each of its shards has; None if it is not said."""
    result: dict[str, list[int] | None] = {}
    splits = info.get("splits")
    for split in splits if isinstance(splits, list) else ():
        if isinstance(split, dict) and isinstance(split.get("name"), str):
            lengths = split.get("shardLengths")
            whole = isinstance(lengths, list) and all(
                re.fullmatch(r"\d{1,12}", str(n)) for n in lengths
            )
            result[split["name"]] = [int(n) for n in lengths] if whole and lengths else None
    return result


IMPORTER = Rlds
