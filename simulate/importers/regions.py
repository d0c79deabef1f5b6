"""LIBERO's regions: the sites that stand for the room inside a drawer, a basket or a tray."""

from __future__ import annotations

import mujoco
import numpy as np

from safestage_eval.episode import Cavity
from simulate.world.describe import Description

ROOM = 0.01
"""m: a site that is flatter than twice this is a place to put things on, not a room."""


def region_cavities(
    model: mujoco.MjModel, data: mujoco.MjData, about: Description
) -> dict[str, Cavity]:
    """Body → the box of its one site named ``…_region``, open to the side that is up now.

    A body with several such rooms has none that its name could identify. Sites on what
    neither moves nor collides (the regions of a table) are none.
    """
    by_body: dict[str, list[Cavity]] = {}
    box = int(mujoco.mjtGeom.mjGEOM_BOX)
    for site in range(model.nsite):
        body = int(model.site_bodyid[site])
        if not model.site(site).name.endswith("_region") or int(model.site_type[site]) != box:
            continue
        if body == 0 or not about.body(body).geoms or model.site_size[site].min() < ROOM:
            continue
        by_body.setdefault(about.body(body).name, []).append(_cavity(model, data, site))
    return {name: cavities[0] for name, cavities in by_body.items() if len(cavities) == 1}


def _cavity(model: mujoco.MjModel, data: mujoco.MjData, site: int) -> Cavity:
    """A site's box, turned so that its z axis is the one that points up in the world."""
    turn = data.site_xmat[site].reshape(3, 3)
    axis = int(np.abs(turn[2]).argmax())
    up = np.eye(3)[axis] * np.sign(turn[2, axis])
    side = np.eye(3)[(axis + 1) % 3]
    local = np.stack([side, np.cross(up, side), up], axis=1)  # cavity → site
    body = np.empty(9)
    mujoco.mju_quat2Mat(body, model.site_quat[site])
    orientation = np.empty(4)
    mujoco.mju_mat2Quat(orientation, np.ascontiguousarray(body.reshape(3, 3) @ local).ravel())
    size = np.abs(local.T) @ model.site_size[site]
    return Cavity.model_validate(
        {
            "kind": "box",
            "size": size.tolist(),
            "position": model.site_pos[site].tolist(),
            "orientation": orientation.tolist(),
        }
    )
