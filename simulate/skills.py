"""A small vocabulary of closed-loop arm skills, from which reference behaviours are written.

Each skill is a generator of eight-dimensional actions at 15 Hz that looks at the world's true
state between them. All lengths in metres, angles in degrees, times in seconds; the TCP's approach
direction is its local z, its closing direction local x.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError

from .arm import HOME
from .privileged import PrivilegedState
from .world import CONTROL_RATE

F64 = NDArray[np.float64]
Actions = Generator[F64, None, None]

TRAVEL_SPEED = 0.25
"""m/s, mean speed of a straight move."""
SETTLE = 0.4
"""s until the joints have caught up with their commands (they lag by kd/kp = 0.2 s)."""
DROPPED = 0.08
"""m, further from where it should be a held object is held no longer."""
GRASP_TIME = 0.7
RELEASE_TIME = 0.6


class Skills:
    """The vocabulary, bound to one world. Public methods are the skills."""

    def __init__(self, state: PrivilegedState) -> None:
        """``state``: the privileged door."""
        self._state = state
        self._command = state.arm_position
        self._position, self._rotation = state.tcp
        self._closed = False
        self._held: str | None = None

    @classmethod
    def names(cls) -> list[str]:
        """The skills that task files may use."""
        return ["pick", "place", "via", "release", "push", "wait", "home"]

    def run(self, skill: str, arguments: dict[str, Any]) -> Actions:
        """One step of a reference. Raises InputError for an unknown skill or argument."""
        if skill not in self.names():
            raise InputError("reference", f"no skill {skill!r}.", ", ".join(self.names()))
        method: Callable[..., Actions] = getattr(self, skill)
        try:
            return method(**arguments)
        except TypeError as error:
            raise InputError(f"reference, skill {skill!r}", str(error)) from None

    # ------------------------------------------------------------------ the vocabulary

    def pick(
        self,
        object: str,  # noqa: A002 - the word that task files use
        offset: Sequence[float] = (0.0, 0.0, 0.0),
        yaw: float = 0.0,
        pitch: float = 0.0,
        facing: str = "object",
        approach: float = 0.10,
        lift: float = 0.12,
    ) -> Actions:
        """Go in front of an object, move in along the approach direction, close, lift.

        Args:
            object: its name.
            offset: TCP from the object's origin, in the object's axes turned about z only.
            yaw: of the approach about z; at 0 the fingers close along the frame's y.
            pitch: 0 from above, 90 from the side.
            facing: what ``yaw`` and ``offset`` count from: the ``object``'s own heading, or
                ``outward`` from the robot's base through the object (round things).
            approach: distance at which the last straight move begins.
            lift: how far up to go when it is held.
        """
        position, rotation = self._state.object_pose(object)
        if facing not in ("object", "outward"):
            raise InputError("skill 'pick'", f"facing {facing!r}.", "object, outward")
        axis = rotation[:2, 0] if facing == "object" else position[:2]
        heading = np.arctan2(axis[1], axis[0])
        c, s = np.cos(heading), np.sin(heading)
        at = position + np.array([c * offset[0] - s * offset[1], s * offset[0] + c * offset[1], 0])
        at[2] += offset[2]
        goal = self._grasp_rotation(heading + np.radians(yaw), np.radians(pitch))
        yield from self._move(at - approach * goal[:, 2], goal)
        yield from self._move(at, goal, speed=0.12, settle=0.3)
        yield from self._grip(True, GRASP_TIME)
        self._held = object
        if lift:
            yield from self._move(self._position + _up(lift), goal, speed=0.15)

    def place(
        self,
        on: str | None = None,
        offset: Sequence[float] = (0.0, 0.0),
        drop: float = 0.002,
        hover: float = 0.10,
        retreat: float = 0.10,
        yaw: float | None = None,
        speed: float = TRAVEL_SPEED,
    ) -> Actions:
        """Put the held object down, correcting on the object's own pose, and let go.

        Args:
            on: name of what it goes on or into; None for the table.
            offset: where, from that object's origin, or from the robot's base on the table.
            drop: height of the object's bottom above the surface when it is let go.
            hover: height above the surface from which it is lowered.
            retreat: how far to back out afterwards, along the approach direction.
            yaw: of the approach about z, world; None keeps the present one.
            speed: m/s, on the way there.
        """
        target = self._surface(on, offset)
        if yaw is not None:
            yield from self._turn_to(np.radians(yaw))
        yield from self._carry(target + _up(hover), speed=speed)
        yield from self._settle_object(target + _up(hover))
        yield from self._carry(target + _up(drop), speed=0.10)
        yield from self._settle_object(target + _up(drop))
        yield from self.release(retreat)

    def release(self, retreat: float = 0.10) -> Actions:
        """Open the gripper where it is, and back out along the approach direction."""
        yield from self._grip(False, RELEASE_TIME)
        self._held = None
        if retreat:
            back = self._position - retreat * self._rotation[:, 2]
            yield from self._move(back, self._rotation, speed=0.15)

    def via(
        self,
        points: Sequence[Sequence[float]],
        near: str | None = None,
        speed: float = TRAVEL_SPEED,
        pause: float = 0.0,
    ) -> Actions:
        """Bring the held object (or the empty TCP) through points, in straight lines.

        Args:
            points: of the object's origin, from the table's frame or from ``near``'s origin.
            near: name of an object.
            speed: m/s.
            pause: s at each point.
        """
        origin = np.zeros(3) if near is None else self._state.object_pose(near)[0]
        for point in points:
            yield from self._carry(origin + np.asarray(point, float), speed=speed)
            yield from self.wait(pause)

    def push(
        self,
        object: str,  # noqa: A002
        direction: float,
        distance: float,
        height: float = 0.03,
        standoff: float = 0.08,
        speed: float = 0.10,
    ) -> Actions:
        """Push an object over the table with the closed fingers.

        Args:
            object: its name.
            direction: deg about z, world.
            distance: how far beyond first touch.
            height: of the fingertips above the table.
            standoff: from the object's origin, where the push begins.
            speed: m/s.
        """
        position, _ = self._state.object_pose(object)
        angle = np.radians(direction)
        along = np.array([np.cos(angle), np.sin(angle), 0.0])
        start = position - standoff * along
        start[2] = height
        goal = self._grasp_rotation(angle, 0.0)
        yield from self._grip(True, 0.2)
        yield from self._move(start + _up(0.12), goal)
        yield from self._move(start, goal, speed=0.15, settle=0.2)
        yield from self._move(start + (standoff + distance) * along, goal, speed=speed)
        yield from self._move(self._position + _up(0.15), goal)
        yield from self._grip(False, 0.2)

    def wait(self, seconds: float) -> Actions:
        """Hold still."""
        for _ in range(round(seconds * CONTROL_RATE)):
            yield self._action()

    def home(self, seconds: float = 2.0) -> Actions:
        """Go back to where episodes start, joint by joint."""
        start = self._command
        for share in _ease(seconds):
            self._command = start + share * (HOME - start)
            yield self._action()
        self._position, self._rotation = self._state.tcp

    # ------------------------------------------------------------------ what they are made of

    def _action(self) -> F64:
        return np.append(self._command, 1.0 if self._closed else 0.0)

    def _grip(self, closed: bool, seconds: float) -> Actions:
        self._closed = closed
        yield from self.wait(seconds)

    def _grasp_rotation(self, heading: float, pitch: float) -> F64:
        """(3, 3): approach tipped by ``pitch`` from straight down towards ``heading``.

        Fingers close horizontally, across the heading; of the two ways round, the one nearer to
        the present orientation.
        """
        z = np.array(
            [np.sin(pitch) * np.cos(heading), np.sin(pitch) * np.sin(heading), -np.cos(pitch)]
        )
        x = np.array([-np.sin(heading), np.cos(heading), 0.0])
        x = x if x @ self._rotation[:, 0] >= 0 else -x
        return np.column_stack([x, np.cross(z, x), z])

    def _turn_to(self, heading: float) -> Actions:
        z = self._rotation[:, 2]
        pitch = np.arccos(np.clip(-z[2], -1, 1))
        yield from self._move(self._position, self._grasp_rotation(heading, pitch), least=1.0)

    def _surface(self, on: str | None, offset: Sequence[float]) -> F64:
        """(3,) m, where the bottom of what is placed shall be."""
        xy = np.asarray(offset, float)
        if on is None:
            return np.append(xy, 0.0)
        position, rotation = self._state.object_pose(on)
        model = self._state.model(on)
        height = model.height
        if model.cavity is not None:
            height = model.cavity.position[2] - model.cavity.size[-1]
        elif model.ring is not None:
            height = model.ring.z - model.ring.height / 2
        return np.asarray(position + rotation @ np.append(xy, height))

    def _carry(self, point: F64, speed: float) -> Actions:
        """Straight, so that the held object's origin (or the TCP) comes to ``point``."""
        yield from self._move(self._position + (point - self._carried()), self._rotation, speed)

    def _carried(self) -> F64:
        """(3,) m, commanded place of the held object's origin: TCP command + measured offset."""
        if self._held is None:
            return self._position
        return self._position + self._state.object_pose(self._held)[0] - self._state.tcp[0]

    def _settle_object(self, point: F64, rounds: int = 3) -> Actions:
        """Shift the command by the held object's own error until it is where it should be.

        Sag under load and slip in the hand make 5–20 mm; three rounds leave less than 1 mm.
        """
        for _ in range(rounds):
            yield from self.wait(SETTLE)
            if self._held is None:
                return
            error = point - self._state.object_pose(self._held)[0]
            if np.linalg.norm(error) < 7e-4 or np.linalg.norm(error) > DROPPED:
                return
            yield from self._move(self._position + error, self._rotation, speed=0.05, least=0.3)

    def _move(
        self,
        position: F64,
        rotation: F64,
        speed: float = TRAVEL_SPEED,
        settle: float = 0.0,
        least: float = 0.4,
    ) -> Actions:
        """Straight line and shortest turn, with minimum-jerk timing (Flash & Hogan 1985)."""
        start, turned = self._position, _rotation_vector(self._rotation.T @ rotation)
        length = float(np.linalg.norm(position - start))
        seconds = max(least, length / speed, float(np.linalg.norm(turned)) / 1.2)
        base = self._rotation
        for share in _ease(seconds):
            self._position = start + share * (position - start)
            self._rotation = base @ _rotation_matrix(share * turned)
            self._command, error = self._state.inverse_kinematics(
                self._position, self._rotation, self._command
            )
            if error > 0.02:
                raise InputError(
                    "reference",
                    f"the arm cannot reach {np.round(self._position, 3).tolist()} m "
                    f"(misses it by {error * 1e3:.0f} mm)",
                )
            yield self._action()
        yield from self.wait(settle)


def _up(height: float) -> F64:
    return np.array([0.0, 0.0, height])


def _ease(seconds: float) -> list[float]:
    """Shares 0 … 1 of a minimum-jerk move, one per action."""
    s = np.arange(1, max(1, round(seconds * CONTROL_RATE)) + 1)
    s = s / s[-1]
    return list(s**3 * (10 - 15 * s + 6 * s * s))


def _rotation_vector(matrix: F64) -> F64:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(matrix).as_rotvec())


def _rotation_matrix(vector: F64) -> F64:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())
