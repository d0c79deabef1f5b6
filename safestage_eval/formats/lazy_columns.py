"""Parts of an episode that are read on first use."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Track

K = TypeVar("K")
V = TypeVar("V")


class StoredItems(Mapping[K, V]):
    """A mapping whose keys are known and whose values are loaded one by one, each once."""

    def __init__(self, keys: Iterable[K], load: Callable[[K], V]) -> None:
        self._keys = dict.fromkeys(keys)
        self._load = load
        self._loaded: dict[K, V] = {}

    def __getitem__(self, key: K) -> V:
        """The value, read on first use. Raises KeyError, or TraceError when it cannot be read."""
        if key not in self._loaded:
            if key not in self._keys:
                raise KeyError(key)
            self._loaded[key] = self._load(key)
        return self._loaded[key]

    def __contains__(self, key: object) -> bool:
        return key in self._keys

    def __iter__(self) -> Iterator[K]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)


class StoredColumns:
    """Columns of a record that are read in groups, each when one of it is first asked for."""

    _groups: ClassVar[tuple[tuple[str, ...], ...]]
    _load: Callable[[tuple[str, ...]], Mapping[str, NDArray[Any]]]

    def __init__(self, load: Callable[[tuple[str, ...]], Mapping[str, NDArray[Any]]]) -> None:
        object.__setattr__(self, "_load", load)

    def __getattr__(self, name: str) -> Any:
        """Reached only for columns that are not loaded yet."""
        group = next((group for group in self._groups if name in group), None)
        if group is None:
            raise AttributeError(name)
        self.__dict__.update(self._load(group))
        return self.__dict__[name]


class StoredTrack(StoredColumns, Track):
    """A track that reads each column by itself: speeds need no turning, and lengths no velocity."""

    _groups = (("position",), ("orientation",), ("linear_velocity",), ("angular_velocity",))

    @property
    def columns(self) -> dict[str, NDArray[np.float32]]:
        """All columns; those that are not loaded yet are read in one go."""
        missing = tuple(name for [name] in self._groups if name not in self.__dict__)
        if missing:
            self.__dict__.update(self._load(missing))
        return super().columns

    def over(self, frames: int) -> Track:
        """The track over so many frames; of a fixed body, too, only what is looked at is read."""
        return _Repeated(self, frames) if len(self) == 1 != frames else super().over(frames)


class _Repeated(StoredColumns, Track):
    """The one row of a fixed body, as often as there are frames."""

    _groups = (("position",), ("orientation",), ("linear_velocity",), ("angular_velocity",))

    def __init__(self, row: Track, frames: int) -> None:
        super().__init__(
            lambda names: {name: _repeated(getattr(row, name), frames) for name in names}
        )


def _repeated(row: NDArray[Any], frames: int) -> NDArray[Any]:
    return np.broadcast_to(row, (frames, row.shape[1]))
