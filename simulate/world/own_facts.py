"""Facts about bodies that the model lacks: kinds, materials, finger sides."""

from __future__ import annotations

import mujoco

from safestage_eval.episode import Tcp
from simulate.arm import droid

from .describe import Facts
from .world import World


def own_facts(world: World) -> list[Facts]:
    """Facts of every body of a world, by MuJoCo's ids."""
    return [_facts(world, i) for i in range(world.model.nbody)]


def _facts(world: World, i: int) -> Facts:
    model = world.model
    name = model.body(i).name
    if name.startswith(droid.PREFIX):
        side = name.removeprefix(droid.PREFIX).partition("_")[0]
        return Facts(
            kind="gripper" if _is_gripper(model, i) else "robot",
            finger=side if side in ("left", "right") else None,
            tcp=_tcp(world, i),
        )
    object_model = world.objects.get(name)
    fixed = bool(model.body_weldid[i] == 0)
    if object_model is None:
        return Facts(kind="fixture" if fixed else "object")
    return Facts(
        kind="region" if object_model.region else "fixture" if fixed else "object",
        up_axis=(0.0, 0.0, 1.0) if object_model.up and not object_model.region else None,
        material=object_model.material,
        tags=object_model.tags,
        cavity=object_model.cavity,
    )


def _is_gripper(model: mujoco.MjModel, body: int) -> bool:
    root = model.body(f"{droid.PREFIX}{droid.GRIPPER_ROOT}").id
    while body:
        if body == root:
            return True
        body = int(model.body_parentid[body])
    return False


def _tcp(world: World, body: int) -> Tcp | None:
    model, site = world.model, world.tcp
    if int(model.site_bodyid[site]) != body:
        return None
    position, orientation = model.site_pos[site].tolist(), model.site_quat[site].tolist()
    return Tcp.model_validate({"position": position, "orientation": orientation})
