"""Stored MuJoCo states into an episode: every row is put into the model and computed anew."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Cavity, Episode, Header
from safestage_eval.errors import InputError
from safestage_eval.formats import CONTACT_POINT, TraceWriter
from safestage_eval.importers import Account, MapFile
from safestage_eval.importers.importer import SourceError
from safestage_eval.importers.missing_data import say_contacts
from safestage_eval.importers.robot_model import opening
from safestage_eval.importers.scene_bodies import apply_map, fixed_from_map
from simulate.world.describe import Description, body_name
from simulate.world.motion_reader import MotionReader

from .foreign_facts import ForeignFacts
from .model_file import Loaded
from .recorder_mujoco import States, Touches, pushed_by_robot, touches_here
from .regions import region_cavities
from .remarks import tell, tell_forces
from .robot_mjcf import tree_below
from .weights import light_contacts, weigh

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Rows:
    """The states of one episode, as the source stored them.

    Attributes:
        loaded: the model, physics alone.
        states: of all rows.
        action: (T, A) commands in force from each row on; A may be 0.
        touches: contacts as the recorder's MuJoCo computes them; None: by this MuJoCo.
        same: this MuJoCo is the recorder's.
    """

    loaded: Loaded
    states: States
    action: F64
    touches: Touches | None = None
    same: bool = False


def split(model: mujoco.MjModel, states: NDArray[np.generic], where: str) -> tuple[F64, F64, F64]:
    """(T,) s, (T, nq), (T, nv) of rows [time, qpos, qvel(, actuator states)].

    Raises:
        InputError: rows that do not belong to the model, or hold numbers that are not finite.
    """
    nq, nv, na = model.nq, model.nv, model.na
    width = 1 + nq + nv
    if states.ndim != 2 or not len(states) or states.shape[1] not in (width, width + na):
        raise InputError(
            where,
            f"its states have the shape {states.shape}; the model has {nq} coordinates and "
            f"{nv} velocities, so that a row must have {width} numbers: time, qpos, qvel.",
            fix="the model_file must be the one with which the states were stored",
        )
    if states.dtype.kind not in "iuf":
        raise InputError(where, f"its states are {states.dtype}.", "numbers")
    rows = np.asarray(states, np.float64)
    if not np.isfinite(rows).all():
        frame = int(np.flatnonzero(~np.isfinite(rows).all(axis=1))[0])
        raise InputError(where, f"row {frame} of its states holds numbers that are not finite.")
    return rows[:, 0], rows[:, 1 : 1 + nq], rows[:, 1 + nq : width]


def episode(rows: Rows, header: Header, map_: MapFile, account: Account) -> Episode:
    """Poses, velocities, contacts and forces of all rows.

    What MuJoCo stored beside a state lags by one step, so everything is computed from the
    coordinates and velocities. Forces are those that bear out the robot's motion (``forward_pass``). Which
    that are hangs on the version of MuJoCo wherever meshes or boxes touch: those that the robot's
    press on are unknown (NaN), unless they come from the recorder's own.

    Args:
        rows: the states.
        header: without bodies and joints.
        map_: what the user says of bodies; masses are put into the model before forces are computed.
        account: receives what is recomputed, guessed or missing.

    Raises:
        InputError: a model with a shape that no trace can hold, or a map file that does not fit.
    """
    model = rows.loaded.model
    data = mujoco.MjData(model)
    weigh(model, data, map_)
    facts = ForeignFacts(model)
    time, qpos, qvel, ctrl = rows.states
    _put(model, data, qpos[0], qvel[0])
    about = Description(model, facts.facts)
    gripper = _gripper(model, about, facts, qpos)
    rooms = region_cavities(model, data, about)
    meshes = {mesh.key: mesh for mesh in about.meshes}
    bodies = tuple(
        apply_map(_plain(body, rows.loaded, rooms), map_, meshes) for body in about.bodies
    )
    _same_shapes(about.bodies, bodies)
    geom_index = _counted_in(about.bodies, bodies)[about.geom_index]
    full = header.model_copy(
        update={
            "bodies": bodies,
            "joints": about.joints,
            "force_source": "none" if rows.loaded.lost else "recomputed",
            "physics_dt": float(model.opt.timestep),
            "gravity": tuple(float(g) for g in model.opt.gravity),
            "parameters": {**header.parameters, **light_contacts(model, about, account)},
        }
    )
    more, places = fixed_from_map({body.name for body in bodies}, map_, meshes)
    writer = TraceWriter(full, meshes=meshes, frames=len(time))
    for i in about.fixed:
        writer.set_fixed(about.body(i).name, data.xpos[i].copy(), data.xquat[i].copy())
    for body in more:
        writer.add_body(body, places[body.name].position[0], places[body.name].orientation[0])
    touches = _touches(rows, model, facts)
    robot = np.array([fact.kind in ("robot", "gripper") for fact in facts.facts])
    enough = ctrl.shape[1] > 0 or len(time) > 2
    known = enough and (rows.touches is not None or rows.same)
    motion = MotionReader(model, data, about.movable)
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and is refused
        for frame, points in enumerate(touches.points):
            _put(model, data, qpos[frame], qvel[frame])
            motion.read()
            if not known:
                unknown = pushed_by_robot(points, model, robot)
                points["force"][unknown] = points["peak_force"][unknown] = np.nan
            for key in ("geom1", "geom2"):
                points[key] = geom_index[points[key]]
            writer.add_frame(
                float(time[frame] - time[0]),
                motion.pose,
                motion.twist,
                contacts=points,
                joint_position=data.qpos[about.joint_qpos],
                joint_velocity=data.qvel[about.joint_dof],
                action=rows.action[frame] if rows.action.shape[1] else None,
                gripper=None if gripper is None else gripper[frame : frame + 1],
            )
    if rows.loaded.lost:
        say_contacts(account)
    else:
        tell_forces(touches.version, account, known=known, commanded=ctrl.shape[1] > 0)
    tell(rows.loaded, facts, bodies, map_, account)
    return writer.episode()


def _touches(rows: Rows, model: mujoco.MjModel, facts: ForeignFacts) -> Touches:
    """Contacts of all rows; none where shapes are lost: what stands on these would seem to fall."""
    if rows.loaded.lost:
        return Touches(mujoco.__version__, [np.zeros(0, CONTACT_POINT)] * len(rows.states.time))
    return rows.touches or touches_here(model, rows.states, facts.driven)


def _gripper(
    model: mujoco.MjModel, about: Description, facts: ForeignFacts, qpos: F64
) -> F64 | None:
    """(T,) how far the gripper is open; None where its fingers do not show it."""
    if facts.hand is None:
        return None
    names = [model.joint(j).name for j in range(model.njnt)]
    positions = {name: qpos[:, model.jnt_qposadr[j]] for j, name in enumerate(names)}
    return opening(tree_below(model, about, int(model.body_rootid[facts.hand])), positions)


def _put(model: mujoco.MjModel, data: mujoco.MjData, qpos: F64, qvel: F64) -> None:
    """Compute poses and velocities of a state."""
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)


def _same_shapes(own: Iterable[Body], mapped: Iterable[Body]) -> None:
    """Raise SourceError where a map file gives a body another number of shapes than its contacts name."""
    for before, after in zip(own, mapped, strict=True):
        if before.geoms and len(after.geoms) != len(before.geoms):
            raise SourceError(
                f"map file, body.{after.name}.shapes",
                f"{len(after.geoms)} shapes, but the model has {len(before.geoms)}, and its contacts "
                "are between those.",
                f"{len(before.geoms)}, in the model's order",
                f"leave out shapes of {after.name}: the model's are taken",
            )


def _counted_in(own: Iterable[Body], mapped: Iterable[Body]) -> NDArray[np.int64]:
    """(G + 1,) the model's shapes → where they are counted once a map has given shapes to other bodies.

    The last one is −1: what is drawn and cannot touch stays out of the count.
    """
    places, before = list[int](), 0
    for one, after in zip(own, mapped, strict=True):
        places += range(before, before + len(one.geoms))
        before += len(after.geoms)
    return np.array([*places, -1], np.int64)


def _plain(body: Body, loaded: Loaded, rooms: Mapping[str, Cavity]) -> Body:
    """With what is not known marked so; what nothing can touch in the source is a mere frame.

    A part of the robot that is drawn and cannot touch is no frame: its shape is missing. So is that of a body
    whose files are.
    """
    said: dict[str, Any]
    robot = body.kind in ("robot", "gripper")
    if body.name in map(body_name, loaded.shapeless):
        said = {"mass": None, "inertia": None}
        if not robot:
            said["untold"] = ("up_axis", "cavity") if body.kind == "object" else ("cavity",)
        return body.model_copy(update=said)
    if not body.geoms:
        drawn = robot and body.name in map(body_name, loaded.drawn)
        return body if drawn else body.model_copy(update={"mass": 0.0})
    said = {"cavity": rooms.get(body.name)}
    if not robot:
        open_ = ("up_axis",) if body.kind == "object" else ()
        said["untold"] = open_ if body.name in rooms else (*open_, "cavity")
    if body.name in map(body_name, loaded.unweighed):
        said |= {"mass": None, "inertia": None}
    return body.model_copy(update=said)
