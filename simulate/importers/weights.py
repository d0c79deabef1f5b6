"""Weights of the bodies of a foreign model, and the lightest contact that still counts."""

from __future__ import annotations

import mujoco
import numpy as np

from safestage_eval.importers import Account, MapFile
from simulate.world.describe import Description, body_name

ORDINARY = 0.1
"""N: the lightest contact that counts by default (``contact_force`` in rules/defaults.toml)."""
SHARE = 0.5
"""Share of the lightest object's weight that each of two supports bears."""


def weigh(model: mujoco.MjModel, data: mujoco.MjData, map_: MapFile) -> None:
    """Give bodies the masses that a map file says; inertias grow with them."""
    changed = False
    for body in range(1, model.nbody):
        said = map_.of_body(body_name(model.body(body).name))
        mass = None if said is None or "mass" not in said.model_fields_set else said.mass
        before = float(model.body_mass[body])
        if mass is None or before in (0, mass):
            continue
        model.body_mass[body] = mass
        model.body_inertia[body] *= mass / before
        changed = True
    if changed:
        mujoco.mj_setConst(model, data)


def light_contacts(model: mujoco.MjModel, about: Description, account: Account) -> dict[str, str]:
    """A lower ``contact_force`` where an object weighs less than the ordinary one; else nothing."""
    gravity = float(np.linalg.norm(model.opt.gravity))
    free = int(mujoco.mjtJoint.mjJNT_FREE)
    weights = {
        about.body(int(i)).name: float(model.body_subtreemass[i]) * gravity
        for j, i in enumerate(model.jnt_bodyid)
        if int(model.jnt_type[j]) == free and about.body(int(i)).kind == "object"
    }
    lightest = min(weights, key=lambda name: weights[name], default=None)
    if lightest is None or not 0 < weights[lightest] < ORDINARY:
        return {}
    least = f"{SHARE * weights[lightest]:.3g} N"
    account.guessed(
        "contact_force",
        f"{least} instead of {ORDINARY:g} N: half the weight of the lightest object, {lightest} "
        f"({weights[lightest]:.2g} N), whose own touch would not count",
        remedy="--set contact_force when scoring, or parameters in a map file",
    )
    return {"contact_force": least}
