"""Guesses what a model does not say of its bodies: kinds, fingers, the opening of a gripper."""

from __future__ import annotations

from typing import Any

import numpy as np

from .told_facts import SIDES, ToldFacts, named_side, names_gripper


class BodyFacts:
    """Kinds and finger sides of a model's bodies, by MuJoCo's ids.

    A tree that an actuator drives, or a mocap body leads, is a robot; what hangs on it and is named as a gripper, is one. A
    body on a free joint is an object. All else is a fixture, with its drawers and doors.

    Attributes:
        kinds: kind of every body.
        sides: body id → left or right, of the gripper's fingers.
        guessed: True where the sides follow from the order of the fingers, not from their names.
    """

    def __init__(
        self,
        model: Any,
        names: list[str],
        told: ToldFacts,
        enums: Any,
    ) -> None:
        """Guess, and put what the user gave in its place.

        Args:
            model: the compiled model.
            names: of its bodies, as the trace has them.
            told: what the user says.
            enums: the ``mujoco`` module.
        """
        self._model, self._names, self._mj = model, names, enums
        self._parent = model.body_parentid.astype(int)
        self._root = model.body_rootid.astype(int)
        self._driven = {int(self._root[b]) for b in self._driven_bodies()} - {0}
        given = told.kinds
        self.kinds = [self._kind(i) for i in range(model.nbody)]
        for i in range(1, model.nbody):
            near: int | None = i
            while near and near not in given:
                near = int(self._parent[near])
            if near:
                self.kinds[i] = given[near]
        if 0 in given:
            self.kinds[0] = given[0]
        self.guessed = False
        self.sides = dict(told.fingers) if told.fingers else self._guess_sides()

    def _kind(self, body: int) -> str:
        if body and int(self._root[body]) in self._driven:
            return "gripper" if self._on_gripper(body) else "robot"
        root = int(self._root[body])
        start = int(self._model.body_jntadr[root])
        free = int(self._mj.mjtJoint.mjJNT_FREE)
        if root and start >= 0 and int(self._model.jnt_type[start]) == free:
            return "object"
        return "fixture" if not root or not self._slides(root) else "object"

    def _slides(self, root: int) -> bool:
        """Whether a body that hangs on no motor moves in the plane or in space by single joints."""
        start, count = int(self._model.body_jntadr[root]), int(self._model.body_jntnum[root])
        slide = int(self._mj.mjtJoint.mjJNT_SLIDE)
        kinds = [int(self._model.jnt_type[j]) for j in range(start, start + count)]
        return kinds.count(slide) >= 2

    def _on_gripper(self, body: int) -> bool:
        while body:
            if names_gripper(self._names[body]):
                return True
            body = int(self._parent[body])
        return False

    def _guess_sides(self) -> dict[int, str]:
        """Sides of what the gripper's joints move: by names, or else the first of two is the left one."""
        model = self._model
        roots: dict[int, list[int]] = {}
        for body in range(1, model.nbody):
            top = self._finger_root(body) if self.kinds[body] == "gripper" else None
            if top is not None:
                roots.setdefault(top, []).append(body)
        named = {top: self._side_of(top) for top in roots}
        if set(named.values()) >= set(SIDES):
            return {b: side for top, side in named.items() if side for b in roots[top]}
        if len(roots) != 2:
            return {}
        self.guessed = True
        return {b: side for top, side in zip(sorted(roots), SIDES) for b in roots[top]}

    def _finger_root(self, body: int) -> int | None:
        """The uppermost body with a joint of its own between it and the gripper's first body."""
        top = None
        while body and self.kinds[body] == "gripper":
            parent = int(self._parent[body])
            if self._model.body_jntnum[body] and self.kinds[parent] == "gripper":
                top = body
            body = parent
        return top

    def _side_of(self, body: int) -> str | None:
        joint = self._model.joint(int(self._model.body_jntadr[body])).name
        return named_side(self._names[body], joint)

    def _driven_bodies(self) -> set[int]:
        """Bodies that an actuator acts on."""
        model, trn = self._model, self._mj.mjtTrn
        driven: set[int] = set()
        for a in range(model.nu):
            kind, target = int(model.actuator_trntype[a]), int(model.actuator_trnid[a, 0])
            if kind in (int(trn.mjTRN_JOINT), int(trn.mjTRN_JOINTINPARENT)):
                driven.add(int(model.jnt_bodyid[target]))
            elif kind in (int(trn.mjTRN_SITE), int(trn.mjTRN_SLIDERCRANK)):
                driven.add(int(model.site_bodyid[target]))
            elif kind == int(trn.mjTRN_BODY):
                driven.add(target)
            elif kind == int(trn.mjTRN_TENDON):
                start = int(model.tendon_adr[target])
                joint = int(self._mj.mjtWrap.mjWRAP_JOINT)
                for w in range(start, start + int(model.tendon_num[target])):
                    if int(model.wrap_type[w]) == joint:
                        driven.add(int(model.jnt_bodyid[int(model.wrap_objid[w])]))
        return driven | self._led_bodies()

    def _led_bodies(self) -> set[int]:
        """Bodies that hang on one which the program moves by hand, as arms without motors do."""
        model, kinds = self._model, self._mj.mjtEq
        led: set[int] = set()
        for e in range(model.neq):
            ends = {int(model.eq_obj1id[e]), int(model.eq_obj2id[e])}
            about = int(model.eq_objtype[e]) if hasattr(model, "eq_objtype") else None
            if int(model.eq_type[e]) not in (int(kinds.mjEQ_WELD), int(kinds.mjEQ_CONNECT)):
                continue
            if about == int(self._mj.mjtObj.mjOBJ_SITE):
                ends = {int(model.site_bodyid[end]) for end in ends}
            if any(int(model.body_mocapid[end]) >= 0 for end in ends):
                led |= {end for end in ends if int(model.body_mocapid[end]) < 0}
        return led

    def finger_joints(self) -> list[int]:
        """Limited joints that move fingers."""
        model = self._model
        return [
            j
            for j in range(model.njnt)
            if int(model.jnt_bodyid[j]) in self.sides and model.jnt_limited[j]
        ]


class Opening:
    """Gripper joints as a share: 0 closed … 1 open.

    Which end of a joint's range is open is tried out: there the fingers are farther apart.
    """

    def __init__(self, model: Any, scratch: Any, facts: BodyFacts, enums: Any) -> None:
        """``scratch``: data whose state may be changed."""
        joints = facts.finger_joints()
        self.address = np.array([int(model.jnt_qposadr[j]) for j in joints], int)
        ends = np.array([model.jnt_range[j] for j in joints], float).reshape(-1, 2)
        self._closed, self._open = ends[:, 0].copy(), ends[:, 1].copy()
        for k, address in enumerate(self.address):
            apart = []
            for end in ends[k]:
                scratch.qpos[:] = model.qpos0
                scratch.qpos[self.address] = ends.mean(axis=1)
                scratch.qpos[address] = end
                enums.mj_kinematics(model, scratch)
                left, right = (self._middle(model, scratch, facts, side) for side in SIDES)
                apart.append(float(np.linalg.norm(left - right)))
            if apart[0] > apart[1]:
                self._closed[k], self._open[k] = ends[k, 1], ends[k, 0]

    def at(self, qpos: Any) -> Any:
        """(T, 1) opening at (T, nq) coordinates, the mean over the joints; (T, 0) without any."""
        if not len(self.address):
            return np.zeros((len(qpos), 0))
        share = (qpos[:, self.address] - self._closed) / (self._open - self._closed)
        return np.clip(share.mean(axis=1, keepdims=True), 0.0, 1.0)

    @staticmethod
    def _middle(model: Any, data: Any, facts: BodyFacts, side: str) -> Any:
        """(3,) m, mean over the shapes of one side's bodies, or their origins where they have none."""
        points = []
        for body in (b for b, s in facts.sides.items() if s == side):
            start, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
            local = model.geom_pos[start : start + count].mean(axis=0) if count else np.zeros(3)
            points.append(data.xpos[body] + data.xmat[body].reshape(3, 3) @ local)
        return np.mean(points, axis=0)
