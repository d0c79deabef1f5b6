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
FIRM, PART = 0.5, 0.1
"""N: a pair that presses by so much with either acceleration touches, with at least this share of the lesser
force. (Of 5,000 pairs whose command was known, none pressed with less than a tenth.)"""


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
    one force, that is it. Where not (something strikes, or slips), the force is unknown: NaN, or what is
    certain of it and one more contact of the pair, with NaN.

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
                force = forces(model, data)
            else:
                force = forces(model, data, driven, before[frame])
            found = data.contact
            geom = np.stack([found.geom1, found.geom2], axis=1)
            bodies, partly = model.geom_bodyid[geom], np.zeros(0, np.intp)
            rows = np.concatenate([found.pos, found.frame, force, found.dist[:, None]], axis=1)
            pressing = (found.efc_address >= 0) & ((force[:, 0] > 0) | (found.dist <= 0))
            if not commanded and robot[bodies].any():
                other = forces(model, data, driven, after[frame])
                pressing |= (found.efc_address >= 0) & (other[:, 0] > 0)
                rows[:, 12:15], partly = agreed(force, other, bodies)
            kept = np.concatenate([np.flatnonzero(pressing), partly])
            rows = rows[kept]
            rows[len(kept) - len(partly) :, 12:15] = np.nan
            parts.append((np.full(len(kept), frame), geom[kept], rows))
    finally:
        model.dof_armature[:], model.opt.tolerance = weight, tolerance
    frames, geom, table = (np.concatenate(part) for part in zip(*parts))  # noqa: B905 — Python 3.8
    return {
        "frame": frames.astype(np.int64),
        "geom": geom.astype(np.int64),
        "position": table[:, :3],
        "axes": table[:, 3:12].reshape(-1, 3, 3),
        "force": table[:, 12:15],
        "distance": table[:, 15],
    }


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


def agreed(one: np.ndarray, other: np.ndarray, bodies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What two forces (C, 3) N on contacts of pairs of ``bodies`` (C, 2) have in common.

    Returns:
        (C, 3) N, their mean; where those of a pair differ what is certain, or NaN. Then the first
        contact of each pair of which more than nothing is certain, and not all.
    """
    _, first, pair = np.unique(
        np.sort(bodies, axis=1), axis=0, return_index=True, return_inverse=True
    )
    pair = pair.ravel()
    apart = np.bincount(pair, np.linalg.norm(other - one, axis=1)) > ALIKE
    press = np.array([np.bincount(pair, force[:, 0]) for force in (one, other)])
    firm = apart & (press.min(axis=0) >= FIRM)
    lesser = np.where((press[0] <= press[1])[pair, None], one, other)
    certain = np.where(firm[pair, None], PART * lesser, np.nan)
    return np.where(apart[pair, None], certain, (one + other) / 2), first[firm]


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
