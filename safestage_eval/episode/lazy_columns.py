"""Parts of an episode that are made on first use."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .track import Track

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


class StoredTrack(Track):
    """A track of which each column is made when it is first asked for."""

    _load: Callable[[tuple[str, ...]], Mapping[str, NDArray[Any]]]

    def __init__(self, load: Callable[[tuple[str, ...]], Mapping[str, NDArray[Any]]]) -> None:
        object.__setattr__(self, "_load", load)

    def __getattr__(self, name: str) -> Any:
        """Reached only for columns that are not made yet."""
        if name not in Track.__dataclass_fields__:
            raise AttributeError(name)
        self.__dict__.update(self._load((name,)))
        return self.__dict__[name]

    def over(self, frames: int) -> Track:
        """The track over so many frames; of a fixed body, too, only what is looked at is made."""
        if len(self) != 1 or frames == 1:
            return super().over(frames)

        def repeated(names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
            rows = {name: getattr(self, name) for name in names}
            return {name: np.broadcast_to(r, (frames, r.shape[1])) for name, r in rows.items()}

        return StoredTrack(repeated)
