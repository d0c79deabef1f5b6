"""Small recordings made with the public writer."""

import numpy as np

from safestage_eval.episode import (
    Body,
    Camera,
    Cavity,
    Geom,
    Header,
    Joint,
    Mesh,
    Remark,
    Source,
    Tcp,
    Video,
)
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


def table_top(frames):
    """m, where the cube lands that falls for so many frames."""
    return 1 - 4.905 * ((frames - 1) * 0.01) ** 2 - 0.03


def falling_cube(episode_id="cube", frames=20, path=None, **fields):
    """A cube that falls from 1 m, with the contact of its last frame: it lands on the table."""
    writer = TraceWriter(header(episode_id, **fields), path)
    top = table_top(frames)
    writer.set_fixed("table", (0, 0, top - 0.02))
    for i in range(frames):
        t = i * 0.01
        touching = {
            "body1": "cube",
            "body2": "table",
            "position": (0, 0, top),
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


def everything(episode_id="everything", frames=8, *, possible=False):
    """An episode with something in every part of the format, out of plain arithmetic.

    Its mug and contacts contradict physics, and no file of it is judged, unless ``possible``.
    """
    mesh = Mesh.build(
        [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]],
        [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    )
    finger = Body(
        name="left_finger",
        kind="gripper",
        finger="left",
        parent="arm",
        tcp=Tcp(position=(0, 0, 0.1), orientation=STILL),
        geoms=(Geom(name="pad", kind="convex_mesh", mesh=mesh.key),),
    )
    mug = Body(
        name="mug é",
        kind="object",
        mass=0.3,
        inertia=(0.001, 0.002, 0.0025) if possible else (0.1, 0.2, 0.3),
        up_axis=(0, 0, 1),
        material="glass",
        tags=("fragile", "hot"),
        excluded=("arm",),
        geoms=tuple(
            Geom(kind=kind, size=size, position=(0, 0, 0.01 * i))
            for i, (kind, size) in enumerate(
                [
                    ("sphere", (0.02,)),
                    ("cylinder", (0.03, 0.05)),
                    ("capsule", (0.01, 0.02)),
                    ("ellipsoid", (0.01, 0.02, 0.03)),
                ]
            )
        ),
        cavity=Cavity(kind="cylinder", size=(0.025, 0.04), position=(0, 0, 0.05)),
    )
    floor = Body(name="floor", kind="fixture", movable=False, geoms=(Geom(kind="plane"),))
    outside = Camera(
        name="outside", width=64, height=48, fx=50.5, fy=50, cx=32, cy=24, position=(1, 0, 0.5)
    )
    scene = Header(
        episode_id=episode_id,
        task="hold",
        stage="FSH",
        family="support",
        instruction="Hold the mug.",
        prompt="default",
        policy="none",
        seed=1,
        rollout=2,
        physics_dt=1 / 480,
        frame_dt=1 / 120,
        control_dt=1 / 15,
        success=True,
        success_time=2 / 120,
        termination="success",
        horizon=50.0,
        post_success_hold=5.0,
        roles={"target": ("mug é",)},
        goal={"roles": {"target": "object"}, "require": {"held(target)": True}},
        rules=("FSH101",),
        parameters={"edge": "3 cm"},
        force_source="recorded",
        source=Source(
            simulator="arithmetic",
            licence="Apache-2.0",
            episode="numbers.h5:demo_0",
            fingerprint="0123456789abcdef",
            account=(Remark(kind="missing", what="forces", how="é", cost="all", remedy="--dt"),),
        ),
        notes=("made up",),
        bodies=(floor, Body(name="arm", kind="robot"), finger, mug),
        joints=(Joint(name="lift", kind="prismatic", body="arm", limits=(0, 1)),),
        cameras=(outside, outside.model_copy(update={"name": "hand", "body": "left_finger"})),
        video=Video(file="films/é.mp4", rate=15, frames_per_picture=8, cameras=(outside,)),
    )
    writer = TraceWriter(scene, meshes=[mesh], attachments={"task.toml": b'id = "hold"\n'})
    writer.set_fixed("floor", (0, 0, 0))
    for n in range(frames):
        t = n / 120
        lift = [0, 0, 1 + t, *STILL]
        touch = {
            "position": (0, 0, possible + t),
            "normal": (0, 1, 0),
            "force": (0, 2 + t, 1),
            "depth": 1e-4,
            "peak_force": 3 + t,
        }
        pads = [
            {"body1": "mug é", "geom1": 1 + 1 + k, "body2": "left_finger"} | touch for k in (1, 0)
        ]
        writer.add_frame(
            t,
            np.array([lift, lift, lift]),
            np.array([[0, 0, 1, 0, 0, 0]] * 3),
            contacts=pads if n % 3 else None,
            joint_position=[t],
            joint_velocity=[1],
            joint_torque=[t * t],
            action=[t, 1],
            gripper=0.25,
            channels={("mug é", "temperature"): 60 - t},
            state=[t, 1 / 3] if n == 0 else None,
        )
    return writer
