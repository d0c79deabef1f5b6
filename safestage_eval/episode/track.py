"""The motion of one body over an episode."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Track:
    """Pose and twist of one body; fixed bodies have T = 1.

    Attributes:
        position: (T, 3) m, body frame's origin, world.
        orientation: (T, 4) wxyz, body frame to world, unit norm.
        linear_velocity: (T, 3) m/s, of the body frame's origin, world.
        angular_velocity: (T, 3) rad/s, world.
    """

    position: F32
    orientation: F32
    linear_velocity: F32
    angular_velocity: F32

    def __len__(self) -> int:
        """T."""
        return len(self.position)

    @property
    def columns(self) -> dict[str, F32]:
        """All of them, by name, in this order."""
        return {column.name: getattr(self, column.name) for column in fields(self)}

    def over(self, frames: int) -> Track:
        """This track with T = frames; a fixed body's single row is repeated as a view."""
        if len(self) == frames:
            return self
        if len(self) != 1:
            raise ValueError(f"a track of {len(self)} frames cannot be stretched to {frames}")
        return Track(
            *(
                np.broadcast_to(column, (frames, column.shape[1]))
                for column in (
                    self.position,
                    self.orientation,
                    self.linear_velocity,
                    self.angular_velocity,
                )
            )
        )


def still_track(position: tuple[float, ...], orientation: tuple[float, ...]) -> Track:
    """The one-row track of a body that never moves; position m, orientation wxyz, world."""
    return Track(
        np.asarray([position], np.float32),
        np.asarray([orientation], np.float32),
        np.zeros((1, 3), np.float32),
        np.zeros((1, 3), np.float32),
    )
