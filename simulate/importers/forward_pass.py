"""Contacts and forces of stored states, in whatever MuJoCo this interpreter has.

Run by ``recorder_mujoco.py`` with the recorder's own interpreter: Python ≥ 3.8, NumPy and mujoco ≥ 2.3
are all that it needs. Lines of standard input are ``IN.npz<tab>OUT.npz``; each is answered by ``ok`` or
by the reason why not.

IN: ``xml``; ``asset_names`` and one array of bytes ``asset_0`` … for each; of the bodies ``mass`` (nbody,) kg,
``inertia`` (nbody, 3), ``centre`` (nbody, 3) m and ``turn`` (nbody, 4); ``qpos`` (T, nq), ``qvel`` (T, nv);
``held`` as in ``put``. OUT: ``version``, ``sizes`` (nq, nv, nbody, ngeom) and of
the C contacts that press or overlap ``frame`` (C,), ``geom`` (C, 2), ``position`` (C, 3) m, ``axes``
(C, 3, 3) with the normal first, ``force`` (C, 3) N along these axes, ``distance`` (C,) m.
"""

from __future__ import annotations

import sys

import mujoco
import numpy as np


def put(
    model: mujoco.MjModel, data: mujoco.MjData, qpos: np.ndarray, qvel: np.ndarray, held: np.ndarray
) -> None:
    """Compute a state anew, with the arm held against its own weight.

    The command is not stored. Controllers of arms make up for gravity: with the motors silent the arm
    would fall, and what it holds would be pressed less.

    Args:
        model: of the scene; ``data``: receives it.
        data: its state does not depend on the one before.
        qpos: (nq,) coordinates.
        qvel: (nv,) velocities.
        held: indices of the degrees of freedom that motors of an arm move; none: silent motors.
    """
    data.qpos[:], data.qvel[:] = qpos, qvel
    data.qacc_warmstart[:], data.qfrc_applied[:] = 0, 0
    mujoco.mj_forward(model, data)
    if len(held) and data.ncon:
        data.qfrc_applied[held] = data.qfrc_bias[held] - data.qfrc_actuator[held]
        data.qacc_warmstart[:] = 0
        mujoco.mj_forward(model, data)


def forward(source: str, target: str) -> None:
    """Compute the contacts of all states of one file and write them to another."""
    with np.load(source, allow_pickle=False) as given:
        names = [str(name) for name in given["asset_names"]]
        assets = {name: given[f"asset_{i}"].tobytes() for i, name in enumerate(names)}
        model = mujoco.MjModel.from_xml_string(str(given["xml"]), assets)
        weights = [given[key] for key in ("mass", "inertia", "centre", "turn")]
        qpos, qvel, held = given["qpos"], given["qvel"], given["held"]
    sizes = (model.nq, model.nv, model.nbody, model.ngeom)
    if len(weights[0]) != model.nbody or qpos.shape[1] != model.nq or qvel.shape[1] != model.nv:
        raise ValueError(f"it reads another model: {sizes} coordinates, velocities, bodies, geoms")
    data = mujoco.MjData(model)
    model.body_mass[:], model.body_inertia[:] = weights[:2]
    model.body_ipos[:], model.body_iquat[:] = weights[2:]
    mujoco.mj_setConst(model, data)
    rows, force = [], np.zeros(6)
    for frame in range(len(qpos)):
        put(model, data, qpos[frame], qvel[frame], held)
        for i in range(data.ncon):
            contact = data.contact[i]
            mujoco.mj_contactForce(model, data, i, force)
            if contact.efc_address < 0 or not (force[0] > 0 or contact.dist <= 0):
                continue
            geoms = contact.geom1, contact.geom2
            rows.append((frame, *geoms, *contact.pos, *contact.frame, *force[:3], contact.dist))
    table = np.array(rows, dtype=np.float64).reshape(-1, 19)
    np.savez(
        target,
        version=mujoco.__version__,
        sizes=np.array(sizes),
        frame=table[:, 0].astype(np.int64),
        geom=table[:, 1:3].astype(np.int64),
        position=table[:, 3:6],
        axes=table[:, 6:15].reshape(-1, 3, 3),
        force=table[:, 15:18],
        distance=table[:, 18],
    )


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
