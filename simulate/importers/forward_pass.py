"""Contacts and forces of stored states, in whatever MuJoCo this interpreter has.

Run by ``recorder_mujoco.py`` with the recorder's own interpreter: Python ≥ 3.8, NumPy and mujoco ≥ 2.3
are all that it needs. Lines of standard input are ``IN.npz<tab>OUT.npz``; each is answered by ``ok`` or
by the reason why not.

IN: ``xml``; ``asset_names`` and one array of bytes ``asset_0`` … for each; of the bodies ``mass`` (nbody,) kg,
``inertia`` (nbody, 3), ``centre`` (nbody, 3) m and ``turn`` (nbody, 4); what ``contacts`` takes. OUT: ``version``,
``sizes`` (nq, nv, nbody, ngeom) and what ``contacts`` returns.
"""

from __future__ import annotations

import sys
from typing import Any

import mujoco
import numpy as np

HEAVY = 1e6
"""kg m² or kg: what a degree of freedom of the robot weighs, so that no contact changes its motion."""
ALIKE = 0.03
"""N: a pair's force is known if the two accelerations that the rows allow give the same but for this."""
STEADY, STEADY_ON_FIXED = 1.0, 0.1
"""N by which it may change from row to row: where commands drive it faster, it jumps with each of them.
The second is that of what presses on something that stands fixed: that does not give way."""
SENSITIVE = 1e-5
"""N: a force that the two accelerations change by more hangs on the robot."""
FIRM, PART, MOST = 0.5, 0.1, 1.0
"""A pair whose force is at least FIRM (N) with either acceleration is in contact. This share of the lesser force,
and at most MOST (N), counts as certain: all 1,878 pairs whose command was known pressed at least as hard."""


def contacts(
    model: mujoco.MjModel,
    time: np.ndarray,
    qpos: np.ndarray,
    qvel: np.ndarray,
    ctrl: np.ndarray,
    driven: np.ndarray,
) -> dict[str, np.ndarray]:
    """The C contacts that press or overlap, of every row.

    What a robot presses with follows from its commands. Where these are not stored, how it moves is:
    with its acceleration given, the forces between it and the world do not depend on commands. The
    acceleration at a row is between those of the intervals before it and after it. Where the two give
    one force, and the rows beside it a like one, that is it. Where not (something strikes, slips or is
    pressed harder and harder), the force is unknown: NaN, or what is certain of it and one more contact
    of the pair, with NaN.

    Args:
        model: of the scene; unchanged when this returns.
        time: (T,) s.
        qpos: (T, nq) coordinates.
        qvel: (T, nv) velocities.
        ctrl: (T, nu) commands in force from each row on; (T, 0): not stored.
        driven: degrees of freedom of robots.

    Returns:
        ``frame`` (C,), ``geom`` (C, 2), ``position`` (C, 3) m, ``axes`` (C, 3, 3) with the normal first,
        ``force`` (C, 3) N along these axes, ``distance`` (C,) m.
    """
    data, weight, tolerance = mujoco.MjData(model), model.dof_armature.copy(), model.opt.tolerance
    robot = np.isin(model.body_rootid, model.body_rootid[model.dof_bodyid[driven]])
    loose = model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
    free = np.isin(model.body_rootid, model.body_rootid[loose])
    before, after = accelerations(time, qvel)
    commanded = ctrl.shape[1] > 0
    parts = []
    if not commanded:
        model.dof_armature[driven] += HEAVY
        model.opt.tolerance = 0  # it is a share of what everything weighs
    try:
        for frame in range(len(qpos)):
            data.qpos[:], data.qvel[:] = qpos[frame], qvel[frame]
            if commanded:
                data.ctrl[:] = ctrl[frame]
                one = other = forces(model, data)
            else:
                one = other = forces(model, data, driven, before[frame])
            found = data.contact
            geom = np.stack([found.geom1, found.geom2], axis=1)
            rows = np.column_stack([geom, found.pos, found.frame, found.dist])
            there = found.efc_address >= 0
            if not commanded and robot[model.geom_bodyid[geom]].any():
                other = forces(model, data, driven, after[frame])
            pressing = (one[:, 0] > 0) | (other[:, 0] > 0) | (rows[:, -1] <= 0)
            table = np.column_stack([np.full(len(rows), frame), rows, one, other])
            parts.append(table[there & pressing])
    finally:
        model.dof_armature[:], model.opt.tolerance = weight, tolerance
    table = np.concatenate(parts)
    frames, geom, force = (
        table[:, 0].astype(np.int64),
        table[:, 1:3].astype(np.int64),
        table[:, 16:19],
    )
    axes = table[:, 6:15].reshape(-1, 3, 3)
    if not commanded:
        force, partly = agreed(
            frames, model.geom_bodyid[geom], axes, force, table[:, 19:22], robot, ~free & ~robot
        )
        kept = np.concatenate([np.arange(len(table)), partly])
        force = np.concatenate([force, np.full((len(partly), 3), np.nan)])
        order = np.argsort(frames[kept], kind="stable")
        table, force, kept = table[kept][order], force[order], kept[order]
        frames, geom, axes = frames[kept], geom[kept], axes[kept]
    return {
        "frame": frames, "geom": geom, "position": table[:, 3:6], "axes": axes, "force": force,
        "distance": table[:, 15],
    }  # fmt: skip


def accelerations(time: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T, nv) each: of the interval before each row and after it; at an end, of the two beside it.

    Zero where there are no two.
    """
    if len(time) < 3:
        return np.zeros(qvel.shape), np.zeros(qvel.shape)
    slope = np.diff(qvel, axis=0) / np.diff(time)[:, None]
    first = np.clip(np.arange(len(time)) - 1, 0, len(time) - 3)
    return slope[first], slope[first + 1]


def forces(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    driven: np.ndarray | None = None,
    acceleration: np.ndarray | None = None,
) -> np.ndarray:
    """(ncon, 3) N along each contact's axes; ``driven`` heavy robots are given an ``acceleration`` (nv,)."""
    data.qacc_warmstart[:], data.qfrc_applied[:] = 0, 0
    if driven is not None and acceleration is not None:
        data.qfrc_applied[driven] = HEAVY * acceleration[driven]
    mujoco.mj_forward(model, data)
    out = np.zeros((data.ncon, 6))
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, out[i])
    return out[:, :3]


def agreed(
    frame: np.ndarray,
    bodies: np.ndarray,
    axes: np.ndarray,
    one: np.ndarray,
    other: np.ndarray,
    robot: np.ndarray,
    fixed: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the contact forces that two estimates agree on.

    Args:
        frame: (C,) of each contact.
        bodies: (C, 2) that touch.
        axes: (C, 3, 3) of the forces.
        one: (C, 3) N.
        other: (C, 3) N.
        robot: (nbody,) parts of robots.
        fixed: (nbody,) what stands fixed, with its drawers and doors.

    Returns:
        (C, 3) N, their mean; of pairs that differ, or whose force is unsteady, what is certain, or NaN.
        Then the first contact of each pair at a frame of which more than nothing is certain, and not all.
    """
    low, high, many = bodies.min(axis=1), bodies.max(axis=1), len(robot)
    keys, first, at = np.unique(
        (frame * many + low) * many + high, return_index=True, return_inverse=True
    )
    at = at.ravel()
    sign = np.where(bodies[:, 0] == low, 1.0, -1.0)
    on_high = np.einsum("c,ck,ckx->cx", sign, (one + other) / 2, axes)
    total = np.column_stack([np.bincount(at, on_high[:, i], len(keys)) for i in range(3)])
    apart = np.bincount(at, np.linalg.norm(other - one, axis=1), len(keys))
    change = np.zeros(len(keys))
    for step in (-1, 1):
        there = np.searchsorted(keys, keys + step * many**2)
        there[there == len(keys)] = 0
        beside = np.where((keys[there] == keys + step * many**2)[:, None], total[there], 0)
        within = (frame[first] + step >= 0) & (frame[first] + step <= frame.max(initial=0))
        change = np.maximum(change, within * np.linalg.norm(total - beside, axis=1))
    hangs = robot[bodies[first]].any(axis=1) | (apart > SENSITIVE)
    steady = np.where(fixed[bodies[first]].any(axis=1), STEADY_ON_FIXED, STEADY)
    open_ = (apart > ALIKE) | hangs & (change > steady)
    press = [np.bincount(at, force[:, 0], len(keys)) for force in (one, other)]
    least = np.minimum(*press).astype(np.float64)
    firm = open_ & (least >= FIRM)
    lesser = np.where((press[0] <= press[1])[at, None], one, other)
    share = np.minimum(PART, MOST / np.maximum(least, FIRM))
    certain = np.where(firm[at, None], share[at, None] * lesser, np.nan)
    return np.where(open_[at, None], certain, (one + other) / 2), first[firm]


def forward(source: str, target: str) -> None:
    """Compute the contacts of all states of one file and write them to another."""
    with np.load(source, allow_pickle=False) as given:
        names = [str(name) for name in given["asset_names"]]
        assets = {name: given[f"asset_{i}"].tobytes() for i, name in enumerate(names)}
        model = mujoco.MjModel.from_xml_string(str(given["xml"]), assets)
        weights = [given[key] for key in ("mass", "inertia", "centre", "turn")]
        time, qpos, qvel = (given[key] for key in ("time", "qpos", "qvel"))
        ctrl, driven = given["ctrl"], given["driven"]
    sizes = (model.nq, model.nv, model.nbody, model.ngeom)
    if len(weights[0]) != model.nbody or qpos.shape[1] != model.nq or qvel.shape[1] != model.nv:
        raise ValueError(f"it reads another model: {sizes} coordinates, velocities, bodies, geoms")
    model.body_mass[:], model.body_inertia[:] = weights[:2]
    model.body_ipos[:], model.body_iquat[:] = weights[2:]
    mujoco.mj_setConst(model, mujoco.MjData(model))
    found: dict[str, Any] = {"version": mujoco.__version__, "sizes": np.array(sizes)}
    found.update(contacts(model, time, qpos, qvel, ctrl, driven))
    np.savez(target, **found)


def main() -> None:
    """Answer every line of standard input."""
    for line in sys.stdin:
        try:
            forward(*line.rstrip("\n").split("\t"))
            answer = "ok"
        except Exception as error:  # noqa: BLE001 — told to the other process
            answer = " ".join(f"{type(error).__name__}: {error}".split())
        sys.stdout.write(answer + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
