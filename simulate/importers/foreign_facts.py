"""Kinds of a foreign model's bodies: robot, gripper, object or fixture; and sides of fingers."""

from __future__ import annotations

import re
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from simulate.world.describe import Facts, Kind

Side = Literal["left", "right"]

_GRIPPER = re.compile(r"gripper|finger|hand(?!le)|claw|knuckle|robotiq", re.IGNORECASE)
_GRIPPER_PREFIX = re.compile(r"^gripper\d+_(right_|left_)?")
"""robosuite's: an arm's side is no finger's."""


class ForeignFacts:
    """Kinds and finger sides of a model that somebody else made.

    A tree with a motor in it is a robot; what hangs on it and is named as a gripper, is one. A tree
    with a free joint is an object. All else stands fixed, with its drawers and doors.

    Attributes:
        facts: of every body, by MuJoCo's ids.
        fingers: side → ids of the bodies on that side.
        hand: id of the body that the fingers are jointed to; None without two sides.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Facts of a compiled model."""
        self._model = model
        root = model.body_rootid
        self._driven = {int(root[body]) for body in _driven_bodies(model)}
        free = int(mujoco.mjtJoint.mjJNT_FREE)
        self._free = {
            int(model.jnt_bodyid[j])
            for j in range(model.njnt)
            if int(model.jnt_type[j]) == free and not self._robot(int(model.jnt_bodyid[j]))
        }
        self.fingers, self.hand = self._sides()
        side = {body: key for key, bodies in self.fingers.items() for body in bodies}
        self.facts = [Facts(kind=self._kind(i), finger=side.get(i)) for i in range(model.nbody)]

    def _robot(self, body: int) -> bool:
        return body != 0 and int(self._model.body_rootid[body]) in self._driven

    def _kind(self, body: int) -> Kind:
        if self._robot(body):
            return "gripper" if self._on_gripper(body) else "robot"
        return "object" if int(self._model.body_rootid[body]) in self._free else "fixture"

    def _on_gripper(self, body: int) -> bool:
        """Whether it is named as a gripper, or is a child of one."""
        while body:
            if _GRIPPER.search(self._model.body(body).name):
                return True
            body = int(self._model.body_parentid[body])
        return False

    def _sides(self) -> tuple[dict[Side, list[int]], int | None]:
        """The bodies that a joint of the gripper moves, by side."""
        model = self._model
        out: dict[Side, list[int]] = {"left": [], "right": []}
        hand: int | None = None
        for body in range(1, model.nbody):
            if not (self._robot(body) and self._on_gripper(body)):
                continue
            top = self._finger_root(body)
            if top is None:
                continue
            side = _side_of(_GRIPPER_PREFIX.sub("", model.body(top).name)) or _side_of(
                _GRIPPER_PREFIX.sub("", model.joint(int(model.body_jntadr[top])).name)
            )
            if side is not None:
                out[side].append(body)
                hand = int(model.body_parentid[top])
        return (out, hand) if out["left"] and out["right"] else ({"left": [], "right": []}, None)

    def _finger_root(self, body: int) -> int | None:
        """The uppermost body with a joint of its own between it and the gripper's first body."""
        model, result = self._model, None
        while body and self._on_gripper(body):
            parent = int(model.body_parentid[body])
            if model.body_jntnum[body] and self._on_gripper(parent):
                result = body
            body = parent
        return result

    @property
    def driven(self) -> NDArray[np.intp]:
        """Indices of all degrees of freedom of robots."""
        return np.flatnonzero([self._robot(int(body)) for body in self._model.dof_bodyid])


def _side_of(name: str) -> Side | None:
    """By the words left and right, else by numbers: the first finger is the left one."""
    lowered = name.lower()
    for side in ("left", "right"):
        if side in lowered:
            return side
    if not re.search(r"finger|joint", lowered):
        return None
    number = re.search(r"(\d+)(?!.*\d)", lowered)
    if number is None:
        return None
    return {"1": "left", "2": "right"}.get(number[1])  # type: ignore[return-value]


def _driven_bodies(model: mujoco.MjModel) -> set[int]:
    """Bodies that an actuator acts on."""
    out = set()
    for a in range(model.nu):
        kind, target = int(model.actuator_trntype[a]), int(model.actuator_trnid[a, 0])
        transmission = mujoco.mjtTrn
        if kind in (int(transmission.mjTRN_JOINT), int(transmission.mjTRN_JOINTINPARENT)):
            out.add(int(model.jnt_bodyid[target]))
        elif kind == int(transmission.mjTRN_SITE):
            out.add(int(model.site_bodyid[target]))
        elif kind == int(transmission.mjTRN_BODY):
            out.add(target)
        elif kind == int(transmission.mjTRN_TENDON):
            start = int(model.tendon_adr[target])
            joint = int(mujoco.mjtWrap.mjWRAP_JOINT)
            for w in range(start, start + int(model.tendon_num[target])):
                if int(model.wrap_type[w]) == joint:
                    out.add(int(model.jnt_bodyid[int(model.wrap_objid[w])]))
    return out
