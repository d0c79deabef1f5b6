"""A robot as a tree of links and joints, and its links' poses at given joint positions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Mesh
from safestage_eval.geometry.pose import compose, rotate

F64 = NDArray[np.float64]
Pose = tuple[F64, F64]
"""(…, 3) m and (…, 4) wxyz."""


@dataclass(frozen=True)
class RobotJoint:
    """A joint of one degree of freedom, in the frame of the link that it moves.

    Attributes:
        name: its name.
        kind: turns about its axis (rad), or slides along it (m).
        axis: (3,) unit vector.
        anchor: (3,) m, a point on the axis.
        limits: rad or m; None without.
        follows: (joint, factor, offset) of a joint whose position gives this one's; None of others.
        rest: rad or m, its position where the link is at ``RobotLink.position``.
    """

    name: str
    kind: Literal["revolute", "prismatic"]
    axis: tuple[float, float, float]
    anchor: tuple[float, float, float] = (0.0, 0.0, 0.0)
    limits: tuple[float, float] | None = None
    follows: tuple[str, float, float] | None = None
    rest: float = 0.0


@dataclass(frozen=True)
class RobotLink:
    """One link.

    Attributes:
        body: as traces have it: name, kind, shapes, mass, finger; ``parent`` is the link before it.
        position: (3,) m, of its frame in its parent's, with its joints at rest.
        orientation: (4,) wxyz, of its frame in its parent's.
        joints: between it and its parent, the first one turns the others.
    """

    body: Body
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    joints: tuple[RobotJoint, ...] = ()


@dataclass(frozen=True)
class RobotModel:
    """Links, each after its parent; the first is the base.

    Attributes:
        links: the base first.
        meshes: that their shapes refer to, by key.
        lost: mesh files of shapes that could not be found or read.
    """

    links: tuple[RobotLink, ...]
    meshes: Mapping[str, Mesh] = field(default_factory=dict)
    lost: tuple[str, ...] = ()

    @cached_property
    def joints(self) -> tuple[RobotJoint, ...]:
        """All of them, in the order of the links."""
        return tuple(joint for link in self.links for joint in link.joints)

    @cached_property
    def driven(self) -> tuple[RobotJoint, ...]:
        """Those that follow no other."""
        return tuple(joint for joint in self.joints if joint.follows is None)

    def layers(self) -> Iterator[RobotJoint]:
        """Joints breadth first, as PhysX numbers the joints of an articulation."""
        depth = {self.links[0].body.name: 0}
        for link in self.links[1:]:
            depth[link.body.name] = depth.get(link.body.parent or "", 0) + 1
        for link in sorted(self.links, key=lambda link: depth[link.body.name]):
            yield from link.joints

    def place(self, base: Pose, positions: Mapping[str, F64]) -> dict[str, Pose]:
        """Poses of all links in the world, exact to rounding.

        Args:
            base: of the base, (T, 3) and (T, 4), or of one frame.
            positions: joint → (T,) rad or m; joints without stay at rest.

        Returns:
            Name of the link → its pose over T frames.
        """
        known = dict(positions)
        for joint in self.joints:
            if joint.follows is not None and joint.name not in known:
                leader, factor, offset = joint.follows
                if leader in positions:
                    known[joint.name] = factor * np.asarray(positions[leader], np.float64) + offset
        poses: dict[str, Pose] = {}
        for i, link in enumerate(self.links):
            pose = (
                (np.asarray(base[0], np.float64), np.asarray(base[1], np.float64))
                if i == 0
                else compose(*poses[link.body.parent or ""], link.position, link.orientation)
            )
            for joint in link.joints:
                if joint.name in known:
                    move = np.asarray(known[joint.name], np.float64) - joint.rest
                    pose = compose(*pose, *_moved(joint, move))
            poses[link.body.name] = pose
        return poses


def _times(by: float, place: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = place
    return by * x, by * y, by * z


def scaled(model: RobotModel, by: float) -> RobotModel:
    """Return the model with all lengths but joint positions ``by`` times as long."""
    meshes = {key: Mesh.build(mesh.vertices * by, mesh.faces) for key, mesh in model.meshes.items()}

    def link_of(link: RobotLink) -> RobotLink:
        geoms = tuple(
            scaled_geom
            if scaled_geom.mesh is None
            else scaled_geom.model_copy(update={"mesh": meshes[scaled_geom.mesh].key})
            for scaled_geom in (geom.scaled(by) for geom in link.body.geoms)
        )
        body = link.body.model_copy(update={"geoms": geoms})
        joints = tuple(replace(j, anchor=_times(by, j.anchor)) for j in link.joints)
        return replace(link, body=body, position=_times(by, link.position), joints=joints)

    links = tuple(link_of(link) for link in model.links)
    return replace(model, links=links, meshes={mesh.key: mesh for mesh in meshes.values()})


def _moved(joint: RobotJoint, by: F64) -> Pose:
    """(T, 3), (T, 4) of the link's frame after the joint, in its frame before it."""
    axis, anchor = np.asarray(joint.axis), np.asarray(joint.anchor)
    if joint.kind == "prismatic":
        return by[:, None] * axis, np.broadcast_to([1.0, 0, 0, 0], (len(by), 4))
    turn = np.column_stack([np.cos(by / 2), np.sin(by / 2)[:, None] * axis])
    return anchor - rotate(turn, np.broadcast_to(anchor, (len(by), 3))), turn


def match_joints(
    model: RobotModel, names: Sequence[str], count: int, chosen: Sequence[str] = ()
) -> tuple[str, ...] | None:
    """The model's joint of each of ``count`` recorded columns.

    Args:
        model: the robot.
        names: of the recorded columns, as far as they have any.
        count: of the recorded columns.
        chosen: what a map file says they are, in order.

    Returns:
        Names; None where neither names nor numbers agree.
    """
    known = {joint.name for joint in model.joints}
    for said in (chosen, names):
        if len(said) == count and set(said) <= known:
            return tuple(said)
        ends = [[name for name in known if name.endswith(one)] for one in said]
        if len(said) == count and said and all(len(end) == 1 for end in ends):
            return tuple(end[0] for end in ends)
    ordered = tuple(joint.name for joint in model.layers())
    alone = tuple(joint.name for joint in model.layers() if joint.follows is None)
    return ordered if len(ordered) == count else alone if len(alone) == count else None


def opening(model: RobotModel, positions: Mapping[str, F64]) -> F64 | None:
    """(T,) how far the gripper is open, 0 closed … 1 open, by the joints of its fingers.

    Which end of a joint's range is open is tried out: there the fingers are farther apart. None
    without fingers on both sides, or without limits.
    """
    sides = {
        side: [link for link in model.links if link.body.finger == side]
        for side in ("left", "right")
    }
    moved = [
        joint for some in sides.values() for link in some for joint in link.joints
        if joint.limits is not None and joint.name in positions
    ]  # fmt: skip
    if not all(sides.values()) or not moved:
        return None
    base = np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]])
    shares = []
    for joint in moved:
        assert joint.limits is not None
        low, high = joint.limits
        apart = []
        for end in (low, high):
            poses = model.place(base, {one.name: np.array([end]) if one is joint else np.array([
                np.mean(one.limits or (0.0, 0.0))]) for one in moved})  # fmt: skip
            left, right = (
                np.mean([_middle(link.body, poses[link.body.name]) for link in some], axis=0)
                for some in sides.values()
            )
            apart.append(float(np.linalg.norm(left - right)))
        share = (np.asarray(positions[joint.name], np.float64) - low) / (high - low)
        shares.append(share if apart[1] > apart[0] else 1 - share)
    return np.asarray(np.clip(np.mean(shares, axis=0), 0.0, 1.0))


def _middle(body: Body, pose: Pose) -> F64:
    points = [geom.position for geom in body.geoms] or [(0.0, 0.0, 0.0)]
    return np.asarray(
        compose(*pose, np.mean(points, axis=0)[None], np.array([[1.0, 0, 0, 0]]))[0][0]
    )
