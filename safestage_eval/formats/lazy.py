"""Parts of an episode that are read when somebody first looks at them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Track

POSE = ("position", "orientation")
TWIST = ("linear_velocity", "angular_velocity")


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
    """A track that reads its poses and its twists separately, each when first asked for."""

    _load: Callable[[tuple[str, ...]], dict[str, NDArray[np.float32]]]

    def __init__(self, load: Callable[[tuple[str, ...]], dict[str, NDArray[np.float32]]]) -> None:
        object.__setattr__(self, "_load", load)

    def __getattr__(self, name: str) -> Any:
        """Reached only for columns that are not loaded yet."""
        group = next((group for group in (POSE, TWIST) if name in group), None)
        if group is None:
            raise AttributeError(name)
        self.__dict__.update(self._load(group))
        return self.__dict__[name]
