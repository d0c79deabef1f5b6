"""Building blocks of skills: straight moves, grips and corrections of the arm, 15 actions a second."""

from __future__ import annotations

from collections.abc import Generator, Sequence

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError
from simulate.world.privileged import PrivilegedState
from simulate.world.world import CONTROL_RATE

F64 = NDArray[np.float64]
Actions = Generator[F64, None, None]

TRAVEL_SPEED = 0.25
"""m/s, mean speed of a straight move."""
SETTLE = 0.4
"""s until the joints have caught up with their commands (they lag by kd/kp = 0.2 s)."""
DROPPED = 0.08
"""m, further from where it should be a held object is held no longer."""


class Motion:
    """The arm's commanded state, and the closed-loop moves that skills put together.

    Attributes:
        state: the privileged door.
        command: (7,) rad, the joints' present command.
        position: (3,) m, the TCP's present command, world.
        rotation: (3, 3), TCP to world, commanded.
        closed: the gripper is commanded to close.
        held: name of the object in it.
    """

    def __init__(self, state: PrivilegedState) -> None:
        """Start where the arm is, with the gripper open."""
        self.state = state
        self.command = state.arm_position
        self.position, self.rotation = state.tcp
        self.closed = False
        self.held: str | None = None

    def action(self) -> F64:
        """(8,) the present command."""
        return np.append(self.command, 1.0 if self.closed else 0.0)

    def hold(self, seconds: float) -> Actions:
        """Hold still."""
        for _ in range(round(seconds * CONTROL_RATE)):
            yield self.action()

    def grip(self, closed: bool, seconds: float) -> Actions:
        """Close or open the gripper, and give it time."""
        self.closed = closed
        yield from self.hold(seconds)

    def grasp_rotation(self, heading: float, pitch: float) -> F64:
        """(3, 3): approach tipped by ``pitch`` from straight down towards ``heading``.

        Fingers close horizontally, across the heading; of the two ways round, the one nearer to
        the present orientation.
        """
        z = np.array(
            [np.sin(pitch) * np.cos(heading), np.sin(pitch) * np.sin(heading), -np.cos(pitch)]
        )
        x = np.array([-np.sin(heading), np.cos(heading), 0.0])
        x = x if x @ self.rotation[:, 0] >= 0 else -x
        return np.column_stack([x, np.cross(z, x), z])

    def turn_to(self, heading: float | None = None, pitch: float | None = None) -> Actions:
        """Turn the gripper until it comes from ``heading``, tipped by ``pitch`` (rad, world).

        What is not given stays as it is; of a gripper that points straight down, the heading is
        the one that its fingers close across.
        """
        z, x = self.rotation[:, 2], self.rotation[:, 0]
        if pitch is None:
            pitch = float(np.arccos(np.clip(-z[2], -1, 1)))
        if heading is None:
            heading = float(np.arctan2(-x[0], x[1]))
        yield from self.move(self.position, self.grasp_rotation(heading, pitch), least=1.0)

    def surface(self, on: str | None, offset: Sequence[float]) -> F64:
        """(3,) m, where the bottom of what is placed shall be.

        ``offset``: from the origin of ``on`` (or the table's), along its axes; with two numbers on
        its top or, if it holds things, its floor.
        """
        xy = np.asarray(offset, float)
        if on is None:
            return np.append(xy, np.zeros(3 - len(xy)))
        position, rotation = self.state.object_pose(on)
        if len(xy) == 3:
            return np.asarray(position + rotation @ xy)
        model = self.state.model(on)
        height = model.height
        if model.cavity is not None:
            height = model.cavity.position[2] - model.cavity.size[-1]
        elif model.ring is not None:
            height = model.ring.z - model.ring.height / 2
        return np.asarray(position + rotation @ np.append(xy, height))

    def carry(self, point: F64, speed: float) -> Actions:
        """Straight, so that the held object's origin (or the TCP) comes to ``point``."""
        yield from self.move(self.position + (point - self.carried()), self.rotation, speed)

    def carried(self) -> F64:
        """(3,) m, commanded place of the held object's origin: TCP command + measured offset."""
        if self.held is None:
            return self.position
        return self.position + self.state.object_pose(self.held)[0] - self.state.tcp[0]

    def settle_object(self, point: F64, rounds: int = 3) -> Actions:
        """Shift the command by the held object's own error until it is where it should be.

        Sag under load and slip in the hand make 5–20 mm; three rounds leave less than 1 mm.
        """
        for _ in range(rounds):
            yield from self.hold(SETTLE)
            if self.held is None:
                return
            error = point - self.state.object_pose(self.held)[0]
            if np.linalg.norm(error) < 7e-4 or np.linalg.norm(error) > DROPPED:
                return
            yield from self.move(self.position + error, self.rotation, speed=0.05, least=0.3)

    def move(
        self,
        position: F64,
        rotation: F64,
        speed: float = TRAVEL_SPEED,
        settle: float = 0.0,
        least: float = 0.4,
    ) -> Actions:
        """Straight line and shortest turn, with minimum-jerk timing (Flash & Hogan 1985)."""
        start, turned = self.position, _rotation_vector(self.rotation.T @ rotation)
        length = float(np.linalg.norm(position - start))
        seconds = max(least, length / speed, float(np.linalg.norm(turned)) / 1.2)
        base = self.rotation
        for share in ease(seconds):
            self.position = start + share * (position - start)
            self.rotation = base @ rotation_matrix(share * turned)
            self.command, error = self.state.inverse_kinematics(
                self.position, self.rotation, self.command
            )
            if error > 0.02:
                raise InputError(
                    "reference",
                    f"the arm cannot reach {np.round(self.position, 3).tolist()} m "
                    f"(misses it by {error * 1e3:.0f} mm)",
                )
            yield self.action()
        yield from self.hold(settle)


def up(height: float) -> F64:
    """(3,) m, straight up."""
    return np.array([0.0, 0.0, height])


def ease(seconds: float) -> list[float]:
    """Shares 0 … 1 of a minimum-jerk move, one per action."""
    s = np.arange(1, max(1, round(seconds * CONTROL_RATE)) + 1)
    s = s / s[-1]
    return list(s**3 * (10 - 15 * s + 6 * s * s))


def _rotation_vector(matrix: F64) -> F64:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(matrix).as_rotvec())


def rotation_matrix(vector: F64) -> F64:
    """(3, 3) of a rotation vector (rad)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())
