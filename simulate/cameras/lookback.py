"""Pictures of earlier moments, for policies that look back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Images = Mapping[str, NDArray[np.uint8]]


class Lookback:
    """Keeps the pictures that later requests will want, and knows when one is to be drawn for them.

    Steps are control steps from the episode's start.
    """

    def __init__(self, back: Sequence[int]) -> None:
        """``back``: how many control steps before each request; nothing is kept where empty."""
        self._back = sorted({step for step in back if step > 0}, reverse=True)
        self._kept: dict[int, Images] = {}

    def due(self, played: int, length: int) -> bool:
        """Whether a later request needs a picture of now.

        Args:
            played: actions that were played of the last answer.
            length: actions of that answer; later ones are taken to be as long.
        """
        left = length - played
        return any(back >= left and (back - left) % length == 0 for back in self._back)

    def keep(self, step: int, images: Images) -> None:
        """The pictures of a step, which is not before those kept already."""
        if not self._back:
            return
        self._kept[step] = images
        oldest = step - self._back[0]
        for old in [old for old in self._kept if old < oldest and len(self._kept) > 1]:
            del self._kept[old]

    def past(self, step: int) -> tuple[Images, ...]:
        """For a request at a step: the pictures of each moment that it looks back to, oldest first.

        The first picture stands for what was before the episode; where answers were not all equally
        long, the picture next in time.
        """
        wanted = [max(step - back, 0) for back in self._back]
        return tuple(self._kept[min(self._kept, key=lambda at: abs(at - w))] for w in wanted)
