"""A small recording made with the public writer: a cube that falls onto a table beside a ball."""

import numpy as np

from safestage_eval.episode import Body, Geom, Header
from safestage_eval.formats import TraceWriter

STILL = (1.0, 0.0, 0.0, 0.0)


def header(episode_id="cube", **more):
    table = Body(name="table", kind="fixture", movable=False, geoms=(box(0.5, 0.5, 0.02),))
    cube = Body(name="cube", kind="object", mass=0.2, geoms=(box(0.03, 0.03, 0.03),))
    ball = Body(name="ball", kind="object", geoms=(Geom(kind="sphere", size=(0.02,)),))
    return Header(
        episode_id=episode_id, physics_dt=0.01, frame_dt=0.01, bodies=(table, cube, ball), **more
    )


def box(*half):
    return Geom(kind="box", size=half)


def pose(z):
    return np.array([[0, 0, z, *STILL], [1, 0, 0.5, *STILL]])


def falling_cube(episode_id="cube", frames=20, path=None, **fields):
    """A cube that falls from 1 m, with the contact of its last frame."""
    writer = TraceWriter(header(episode_id, **fields), path)
    writer.set_fixed("table", (0, 0, -0.02))
    for i in range(frames):
        t = i * 0.01
        touching = {
            "body1": "cube",
            "body2": "table",
            "position": (0, 0, 0),
            "normal": (0, 0, -1),
            "force": (0, 0, -2),
        }
        writer.add_frame(
            t,
            pose(1 - 4.905 * t * t),
            np.array([[0, 0, -9.81 * t, 0, 0, 0], [0] * 6]),
            contacts=[touching] if i == frames - 1 else None,
        )
    return writer
