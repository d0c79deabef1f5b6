"""Places the links of a body by its base and its joints, as the simulator itself does, many frames at a time."""

from __future__ import annotations

from typing import Any, Mapping, NamedTuple

import numpy as np

from .scene_parts import cross, multiply, turn

_INVERSE = np.array([1.0, -1.0, -1.0, -1.0])


class Hinge(NamedTuple):
    """How a link hangs on the one above it.

    Attributes:
        parent: number of the link above.
        axis: (3,) unit vector in the link's frame, along or about which its joint moves.
        slides: whether the joint is prismatic.
        joint: number of the joint; None where it is fixed.
    """

    parent: int
    axis: Any
    slides: bool
    joint: int | None


class Motion(NamedTuple):
    """Where links are: (T, L, 3) m, (T, L, 4) wxyz, (T, L, 3) m/s and rad/s of the frames of L links."""

    position: Any
    orientation: Any
    linear: Any
    angular: Any


class LinkTree:
    """Links whose joints turn about the origin of the link's frame, or slide."""

    def __init__(
        self, hinges: Mapping[int, Hinge], position: Any, orientation: Any, joints: Any
    ) -> None:
        """Learn the tree from one moment.

        Args:
            hinges: number of a link → how it hangs, those above before those below; the others are placed by
                the simulator.
            position: (L, 3) m.
            orientation: (L, 4) wxyz.
            joints: (J,) rad or m.
        """
        self._links = list(hinges)
        self._above = [hinge.parent for hinge in hinges.values()]
        back = orientation[self._above] * _INVERSE
        self._away = turn(back, position[self._links] - position[self._above])
        self._turned = multiply(back, orientation[self._links])
        self._axes = np.array([hinge.axis for hinge in hinges.values()]).reshape(-1, 3)
        self._further = multiply(self._turned, np.pad(self._axes, ((0, 0), (1, 0))))
        self._along = turn(self._turned, self._axes)
        # a fixed joint takes the last column, which is zero
        self._joint = [-1 if h.joint is None else h.joint for h in hinges.values()]
        self._slides = np.array([hinge.slides for hinge in hinges.values()], bool)
        self._zero = np.append(np.asarray(joints, float), 0.0)[self._joint]

    def place(self, motion: Motion, joints: Any, speeds: Any) -> None:
        """Fill in the motion of the links that have a hinge.

        Args:
            motion: of all links; those without a hinge are there.
            joints: (T, J) rad or m.
            speeds: (T, J) rad/s or m/s.
        """
        position, orientation, linear, angular = motion
        links, above, slides = self._links, self._above, self._slides
        nothing = np.zeros((len(joints), 1))
        moved = np.concatenate([joints, nothing], axis=1)[:, self._joint] - self._zero
        speed = np.concatenate([speeds, nothing], axis=1)[:, self._joint, None]
        half = np.where(slides, 0.0, moved / 2)[..., None]
        own = np.cos(half) * self._turned + np.sin(half) * self._further
        away = self._away + np.where(slides, moved, 0.0)[..., None] * self._along
        for k, (i, parent) in enumerate(zip(links, above)):
            orientation[:, i] = multiply(orientation[:, parent], own[:, k])
        arm = turn(orientation[:, above], away)
        axis = turn(orientation[:, links], self._axes) * speed
        slide, spin = np.where(slides[:, None], axis, 0.0), np.where(slides[:, None], 0.0, axis)
        for k, (i, parent) in enumerate(zip(links, above)):
            position[:, i] = position[:, parent] + arm[:, k]
            angular[:, i] = angular[:, parent] + spin[:, k]
        slide += cross(angular[:, above], arm)
        for k, (i, parent) in enumerate(zip(links, above)):
            linear[:, i] = linear[:, parent] + slide[:, k]
