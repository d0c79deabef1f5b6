"""Hostile RLDS sets: damaged files, and records that say something else under checksums that are right."""

from __future__ import annotations

import json
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from damage import damaged
from import_target import Import, episode
from rlds_sets import field, record, varint, write_rlds
from strange import NAMES, NUMBERS, altered

from safestage_eval.importers.tfrecord import crc32c, parse_example, read_record, record_places

Features = list[tuple[bytes, bytes]]
"""Name and ``Feature`` of each entry: a file may have one name twice, or names that are no text."""

FLOATS, WHOLE, TEXTS = 2, 3, 1
"""Numbers of the fields of a ``Feature``."""


class Rlds(Import):
    """TFRecord and JSON."""

    name = "RLDS"
    read_by = ("protobuf",)

    def write(self, folder: Path) -> tuple[Path, str]:
        """One episode."""
        source, columns = write_rlds(folder / "set", [episode()])
        [self._records] = source.glob("*.tfrecord*")
        [place] = record_places(self._records)
        self._data = read_record(self._records, place)
        parsed = parse_example(self._data, "the sound set")
        self._features = [(key.encode(), f.SerializeToString()) for key, f in parsed.items()]
        return source, columns

    def hurt(self, rng: Random, path: Path) -> tuple[str, bool]:
        """Damage to a file, to the description's meaning, or within the record."""
        kind = rng.random()
        if kind < 0.3:
            return super().hurt(rng, path)
        file = path / self._records.relative_to(self.seed)
        if kind < 0.45:
            chosen = rng.choice(sorted(file.parent.glob("*.json")))
            tree, what = altered(rng, json.loads(chosen.read_text("utf-8")))
            chosen.write_text(json.dumps(tree), "utf-8")
            return f"{chosen.name}: {what}", False
        if kind < 0.6:
            data, what = damaged(rng, self._data, [0, 1, 4, 8, 16])
            file.write_bytes(record(data, crc32c))
            return f"record: {what}", False
        act = rng.choice((_numbers, _numbers, _steps, _kind, _gone, _twice, _texts, _records))
        data, what, is_damage = act(rng, list(self._features))
        file.write_bytes(data)
        return f"{act.__name__.strip('_')}: {what}", is_damage


def _packed(features: Features) -> bytes:
    """A record of an ``Example``."""
    entries = (field(1, field(1, key) + field(2, feature)) for key, feature in features)
    return record(field(1, b"".join(entries)), crc32c)


def _floats(values: Any) -> bytes:
    return field(FLOATS, field(1, np.asarray(values, "<f4").tobytes()))


def _values(feature: bytes) -> np.ndarray | None:
    """The numbers of a feature that has floats."""
    parsed = parse_example(field(1, field(1, field(1, b"x") + field(2, feature))), "a feature")["x"]
    return np.array(parsed.float_list.value, "<f4") if len(parsed.float_list.value) else None


def _of_floats(rng: Random, features: Features) -> tuple[int, np.ndarray]:
    """A column of floats, and its numbers."""
    columns = [(i, _values(feature)) for i, (_, feature) in enumerate(features)]
    return rng.choice([(i, values) for i, values in columns if values is not None])


def _numbers(rng: Random, features: Features) -> tuple[bytes, str, bool]:
    """Other numbers in some places of a column."""
    i, values = _of_floats(rng, features)
    number = rng.choice(NUMBERS)
    with np.errstate(over="ignore"):
        values[[rng.randrange(len(values)) for _ in range(rng.choice((1, 1, 20)))]] = number
    features[i] = features[i][0], _floats(values)
    return _packed(features), f"{features[i][0]!r} {number}", not np.isfinite(values).all()


def _steps(rng: Random, features: Features) -> tuple[bytes, str, bool]:
    """More or fewer numbers in one column, or steps that are gone from all of them."""
    frames = len(episode())
    if rng.random() < 0.5:
        i, values = _of_floats(rng, features)
        size = rng.choice((0, 1, len(values) - 1, len(values) + 1, len(values) * 2, 5_000_000))
        features[i] = features[i][0], _floats(np.resize(values, size))
        return _packed(features), f"{features[i][0]!r} of {size}", False
    kept = sorted(rng.sample(range(frames), rng.choice((0, 1, 2, frames // 2, frames - 1))))
    if rng.random() < 0.5:
        kept = list(range(len(kept)))
    for i, (key, feature) in enumerate(features):
        values = _values(feature)
        if values is not None:
            features[i] = key, _floats(values.reshape(frames, -1)[kept])
    return _packed(features), f"{len(kept)} of {frames}", False


def _kind(rng: Random, features: Features) -> tuple[bytes, str, bool]:
    """Texts, whole numbers or nothing in the place of what was there."""
    i = rng.randrange(len(features))
    feature = rng.choice(
        (
            b"",
            field(TEXTS, b""),
            field(TEXTS, field(1, b"\xff" * rng.choice((0, 1, 100_000)))),
            field(WHOLE, field(1, varint(rng.choice((0, -1, 2**63 - 1))) * len(episode()))),
            field(WHOLE, field(1, b"\0" * rng.choice((1, 3_000_000)))),
            field(FLOATS, b""),
            features[rng.randrange(len(features))][1],
            features[i][1] + field(TEXTS, field(1, b"x")),
        )
    )
    features[i] = features[i][0], feature
    return _packed(features), f"{features[i][0]!r}: {feature[:12]!r}, {len(feature)} bytes", False


def _gone(rng: Random, features: Features) -> tuple[bytes, str, bool]:
    """A column."""
    key, _ = features.pop(rng.randrange(len(features)))
    return _packed(features), repr(key), True


def _twice(rng: Random, features: Features) -> tuple[bytes, str, bool]:
    """A column under another's name, or under one that nobody knows; thousands of them."""
    key, feature = rng.choice(features)
    names = [key, rng.choice(features)[0], b"\xff", b"", b"steps/", b"steps/\0"]
    names += [name.encode("utf-8", "surrogatepass") for name in NAMES]
    name, times = rng.choice(names), rng.choice((1, 1, 1, 2000))
    added = [(name + str(n).encode() if times > 1 else name, feature[:64]) for n in range(times)]
    rng.choice((features.extend, lambda more: features.__setitem__(slice(0, 0), more)))(added)
    return _packed(features), f"{name[:40]!r}, {times} times", False


def _texts(rng: Random, features: Features) -> tuple[bytes, str, bool]:
    """Another instruction, of any letters and of any length."""
    text = rng.choice((*NAMES, "x" * 100_000)).encode("utf-8", "surrogatepass")
    texts = field(TEXTS, field(1, text) * rng.choice((1, 1, len(episode()), 2000)))
    features = [(k, texts if k.endswith(b"instruction") else f) for k, f in features]
    return _packed(features), f"{text[:40]!r}", False


def _records(rng: Random, features: Features) -> tuple[bytes, str, bool]:
    """More records than were announced, empty ones, or none."""
    whole, times = _packed(features), rng.choice((0, 1, 2, 100, 20_000))
    if times > 2 or rng.random() < 0.5:
        return record(b"") * times, f"{times} empty ones", False
    return whole * times, f"{times} times", False


TARGETS = {"rlds": Rlds}
