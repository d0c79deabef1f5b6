"""Episodes whose numbers were stored in fewer digits, as recorders do that save space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import ContactTable, Episode, RobotFrames, Track

Rounding = Callable[[NDArray[Any]], NDArray[Any]]


def to_float16(values: NDArray[Any]) -> NDArray[Any]:
    most = np.finfo(np.float16).max
    return values.clip(-most, most).astype(np.float16).astype(values.dtype)


def to_bits(values: NDArray[Any], bits: int = 11) -> NDArray[Any]:
    """So many significant bits, the leading one among them."""
    part, power = np.frexp(values)
    return np.ldexp(np.round(part * 2**bits) / 2**bits, power).astype(values.dtype)


def to_digits(values: NDArray[Any], digits: int = 3) -> NDArray[Any]:
    with np.errstate(divide="ignore"):
        size = np.floor(np.log10(np.abs(values.astype(np.float64))))
    by = 10.0 ** np.where(np.isfinite(size), digits - 1 - size, 0)
    return (np.round(values * by) / by).astype(values.dtype)


def to_steps(values: NDArray[Any], step: float = 1 / 32) -> NDArray[Any]:
    return (np.round(values / step) * step).astype(values.dtype)


ROUNDINGS: dict[str, Rounding] = {"float16": to_float16, "11 bits": to_bits, "3 digits": to_digits}


def rounded(episode: Episode, by: Rounding) -> Episode:
    """The episode with every column of single precision rounded; times stay."""

    def all_of(kind: type, table: Any) -> Any:
        columns = (getattr(table, f.name) for f in fields(kind))
        return kind(*(by(c) if c.dtype == np.float32 else c for c in columns))

    return replace(
        episode,
        tracks={name: all_of(Track, track) for name, track in episode.tracks.items()},
        _contacts=all_of(ContactTable, episode.contacts),
        _frames=all_of(RobotFrames, episode.frames),
        channels={key: by(values) for key, values in episode.channels.items()},
    )


def in_steps(episode: Episode, step: float = 1 / 32) -> Episode:
    """The episode with forces and peaks in steps of so many N."""
    table = episode.contacts
    new = {name: to_steps(getattr(table, name), step) for name in ("force", "peak_force")}
    return with_columns(episode, **new)


def with_columns(episode: Episode, **columns: NDArray[Any]) -> Episode:
    """The episode with other columns of contacts."""
    table = episode.contacts
    whole = (columns.get(f.name, getattr(table, f.name)) for f in fields(ContactTable))
    return replace(episode, _contacts=ContactTable(*whole))
