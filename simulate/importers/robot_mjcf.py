"""A robot from MJCF, as MuJoCo compiles it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np

from safestage_eval.errors import InputError
from safestage_eval.importers.importer import SourceError
from safestage_eval.importers.robot_model import RobotJoint, RobotLink, RobotModel
from safestage_eval.size_limits import current
from simulate.world.describe import Description

from .foreign_facts import ForeignFacts
from .model_file import UNREADABLE


def _check_nested(path: Path, whole: Path, seen: set[Path]) -> None:
    """Refuse a nested model without a file: MuJoCo hangs in every model that it reads after one."""
    if path in seen or not path.is_file() or path.stat().st_size > current().document:
        return
    seen.add(path)
    try:
        root = ET.fromstring(path.read_bytes())  # noqa: S314 — no external entities are resolved
    except ET.ParseError:
        return  # MuJoCo says where
    if any(not element.get("file") for element in root.iterfind(".//asset/model")):
        raise InputError(str(whole), "a <model> in its <asset> names no file.", '<model file="…"/>')
    for tag in ("include", "model"):
        for element in root.iter(tag):
            _check_nested(path.parent / element.get("file", ""), whole, seen)


def robot_from_mjcf(path: Path) -> RobotModel:
    """Read a robot, the tree of bodies with the most joints of a model.

    Raises:
        InputError: MuJoCo cannot read it, or it has a shape that no trace can hold.
        SourceError: nothing in it is jointed.
    """
    _check_nested(path, path, set())
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except UNREADABLE as error:
        raise InputError(
            str(path), f"MuJoCo cannot read it: {' '.join(str(error).split())}."
        ) from None
    jointed = [body for j, body in enumerate(model.jnt_bodyid) if _joint(model, j) is not None]
    if not jointed:
        raise SourceError(str(path), "has no joint that turns or slides.", "the model of a robot")
    roots = [int(model.body_rootid[body]) for body in jointed]
    root = max(dict.fromkeys(roots), key=roots.count)
    return tree_below(model, Description(model, ForeignFacts(model).facts), root)


def tree_below(model: mujoco.MjModel, about: Description, root: int) -> RobotModel:
    """The links of one tree of bodies; ``root``: MuJoCo's id of its first."""
    links = []
    for body in np.flatnonzero(model.body_rootid == root):
        said = about.body(int(body))
        first = int(model.body_jntadr[body])
        joints = [_joint(model, j) for j in range(first, first + int(model.body_jntnum[body]))]
        update = {
            "kind": "robot" if said.kind in ("object", "fixture") else said.kind,
            "parent": None if body == root else about.body(int(model.body_parentid[body])).name,
            "movable": True,
            "mass": said.mass if said.geoms else 0.0,  # what can touch nothing is a mere frame
        }
        links.append(
            RobotLink(
                said.model_copy(update=update),
                tuple(model.body_pos[body].tolist()),
                tuple(model.body_quat[body].tolist()),
                tuple(joint for joint in joints if joint is not None),
            )
        )
    return RobotModel(tuple(links), {mesh.key: mesh for mesh in about.meshes})


def _joint(model: mujoco.MjModel, j: int) -> RobotJoint | None:
    """A joint that turns or slides; None of others."""
    slides = int(model.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    if not slides and int(model.jnt_type[j]) != int(mujoco.mjtJoint.mjJNT_HINGE):
        return None
    limited = bool(model.jnt_limited[j])
    low, high = model.jnt_range[j].tolist()
    follows = None
    for e in range(model.neq):
        joint = int(mujoco.mjtEq.mjEQ_JOINT)
        if (
            int(model.eq_type[e]) == joint
            and int(model.eq_obj1id[e]) == j
            and model.eq_obj2id[e] >= 0
        ):
            offset, factor, *curved = model.eq_data[e][:5].tolist()
            if not np.any(curved):
                other = int(model.eq_obj2id[e])
                rest = float(model.qpos0[model.jnt_qposadr[j]])
                before = float(model.qpos0[model.jnt_qposadr[other]])
                follows = (model.joint(other).name, factor, rest + offset - factor * before)
    return RobotJoint(
        model.joint(j).name,
        "prismatic" if slides else "revolute",
        tuple(model.jnt_axis[j].tolist()),
        tuple(model.jnt_pos[j].tolist()),
        (low, high) if limited else None,
        follows,
        float(model.qpos0[model.jnt_qposadr[j]]),
    )
