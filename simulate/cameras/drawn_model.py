"""The model that cameras draw: the world's bodies in paint, in a room. It is never stepped."""

from __future__ import annotations

import mujoco

from simulate.looks.room import Look, furnish
from simulate.looks.skins import catalogue_name, paint_shapes
from simulate.world.world import FLOOR_Z, TABLE_CENTRE, TABLE_HALF, World, scene_spec

HIDDEN_GROUP = 4
"""MuJoCo's visual group of what the room has in its place; it is not drawn."""


def drawn_model(world: World) -> mujoco.MjModel:
    """A model of the same bodies and joints as the world's, dressed for its look.

    Its joint positions have the same places, so that a state of the world can be put into it as it
    is. The world's own model has nothing of it: what is drawn cannot change what happens.
    """
    look = Look.drawn(*world.look)
    spec = scene_spec(world.objects, world.substeps, world.robot_mjcf, world.look, visuals=True)
    for light in list(spec.lights):
        spec.delete(light)
    for name in ("table", "floor"):
        _hide(spec.body(name))
    for name, model in world.objects.items():
        if model.region:
            _hide(spec.body(name))
        else:
            paint_shapes(spec, spec.body(name).geoms, name, catalogue_name(model), model)
    furnish(spec, look, (TABLE_HALF, TABLE_CENTRE), FLOOR_Z)
    return spec.compile()


def _hide(body: mujoco.MjsBody) -> None:
    for geom in body.geoms:
        geom.group = HIDDEN_GROUP
