"""Random episodes that satisfy every invariant, for properties that must hold for all of them."""

import numpy as np
from hypothesis import strategies as st

from safestage_eval.episode import (
    Body,
    Cavity,
    ContactTable,
    Episode,
    Geom,
    Header,
    Joint,
    Mesh,
    RobotFrames,
    Source,
    Tcp,
    Track,
)

SIZES = {"sphere": 1, "box": 3, "cylinder": 2, "capsule": 2, "ellipsoid": 3, "plane": 0}

metres = st.floats(0.001, 2.0)
coordinates = st.floats(-3.0, 3.0)
vectors = st.tuples(coordinates, coordinates, coordinates)
names = st.text("abcXYZ0_ .é/", min_size=1, max_size=8)


@st.composite
def quaternions(draw):
    """Unit quaternions, wxyz, as plain floats."""
    q = np.array(draw(st.tuples(*[st.floats(-1, 1)] * 4)))
    q = q if np.linalg.norm(q) > 0.1 else np.array([1.0, 0, 0, 0])
    return tuple((q / np.linalg.norm(q)).tolist())


@st.composite
def mesh_shapes(draw):
    """A tetrahedron with faces, or a bare set of points."""
    scale = draw(metres)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]) * scale
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    return Mesh.build(corners, faces if draw(st.booleans()) else ())


@st.composite
def geoms(draw, meshes):
    """A geom of any kind; a mesh is put into the given dictionary."""
    kind = draw(st.sampled_from([*SIZES, "convex_mesh", "mesh"]))
    mesh = None
    if kind.endswith("mesh"):
        shape = draw(mesh_shapes())
        mesh = shape.key
        meshes[mesh] = shape
    return Geom(
        name=draw(st.sampled_from(["", "a", "b"])),
        kind=kind,
        size=tuple(draw(metres) for _ in range(SIZES.get(kind, 0))),
        position=draw(vectors),
        orientation=draw(quaternions()),
        mesh=mesh,
    )


@st.composite
def bodies(draw, name, meshes):
    """A body with up to three geoms and any of the optional fields."""
    return Body(
        name=name,
        kind=draw(st.sampled_from(["robot", "gripper", "object", "fixture", "region"])),
        movable=draw(st.booleans()),
        mass=draw(st.none() | metres),
        com=draw(vectors),
        inertia=draw(st.none() | st.tuples(metres, metres, metres)),
        up_axis=draw(st.none() | st.just((0.0, 0.0, 1.0))),
        finger=draw(st.none() | st.sampled_from(["left", "right"])),
        tcp=draw(st.none() | st.builds(Tcp, position=vectors, orientation=quaternions())),
        material=draw(st.none() | names),
        tags=tuple(draw(st.lists(names, max_size=2))),
        geoms=tuple(draw(st.lists(geoms(meshes), max_size=3))),
        cavity=draw(
            st.none()
            | st.just(Cavity(kind="box", size=(0.1, 0.1, 0.05)))
            | st.builds(Cavity, kind=st.just("cylinder"), size=st.tuples(metres, metres))
        ),
    )


def random_track(rng, frames):
    """Any motion over so many frames."""
    q = rng.normal((3, 0, 0, 0), size=(frames, 4))
    columns = (
        rng.normal(size=(frames, 3)),
        q / np.linalg.norm(q, axis=1, keepdims=True),
        rng.normal(size=(frames, 3)),
        rng.normal(size=(frames, 3)),
    )
    return Track(*(column.astype(np.float32) for column in columns))


def random_contacts(rng, header, frames, count):
    """Contacts between geoms of different bodies, in random order, several per pair."""
    owner = np.repeat(np.arange(len(header.bodies)), [len(b.geoms) for b in header.bodies])
    if len(set(owner.tolist())) < 2:
        return ContactTable.empty()
    pairs = [(a, b) for a in range(len(owner)) for b in range(len(owner)) if owner[a] != owner[b]]
    geom1, geom2 = np.array(pairs)[rng.integers(len(pairs), size=count)].reshape(-1, 2).T
    normal = rng.normal(size=(count, 3))
    return ContactTable.build(
        rng.integers(frames, size=count),
        owner[geom1],
        owner[geom2],
        geom1,
        geom2,
        rng.normal(size=(count, 3)),
        normal / np.linalg.norm(normal, axis=1, keepdims=True),
        rng.normal(size=(count, 3)) * rng.integers(0, 2, size=(count, 1)),
        rng.random(count),
        rng.normal(size=count) * 1e-4,
    )


@st.composite
def episodes(draw, max_frames=12):
    """Episodes with everything an episode may have, from a single frame and body on."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    frames = draw(st.integers(1, max_frames))
    meshes = {}
    body_names = draw(st.lists(names, min_size=1, max_size=5, unique=True))
    everybody = tuple(draw(bodies(name, meshes)) for name in body_names)
    joints = draw(st.integers(0, 3))
    optional = st.none() | names
    t = draw(st.sampled_from([0.0, 1.5])) + np.cumsum(rng.uniform(1e-3, 0.1, frames))
    spacing = float(np.median(np.diff(t))) if frames > 1 else 1 / 120
    success = draw(st.none() | st.booleans())
    seconds = st.floats(0, 10, allow_nan=False)
    header = Header(
        episode_id=draw(names),
        task=draw(optional),
        stage=draw(st.sampled_from([None, "ISH", "ETS", "FSH"])),
        instruction=draw(optional),
        policy=draw(optional),
        seed=draw(st.none() | st.integers(-(2**40), 2**40)),
        rollout=draw(st.none() | st.integers(0, 99)),
        physics_dt=draw(st.sampled_from([1 / 120, 1 / 480, 0.002])),
        frame_dt=spacing * draw(st.sampled_from([0.92, 1.0, 1.05])),
        control_dt=draw(st.none() | st.just(1 / 15)),
        success=success,
        success_time=None
        if success is False
        else draw(st.none() | seconds.map(lambda after: float(t[0]) + after)),
        termination=draw(st.sampled_from([None, "success", "horizon", "error"])),
        roles=draw(
            st.dictionaries(names, st.lists(st.sampled_from(body_names), max_size=2), max_size=2)
        ),
        goal=draw(st.none() | names | st.just({"roles": {"a": "object"}, "require": {"x": True}})),
        rules=tuple(draw(st.lists(names, max_size=2))),
        parameters=draw(st.dictionaries(names, names, max_size=2)),
        force_source=draw(st.sampled_from(["recorded", "recomputed", "none"])),
        source=Source(simulator=draw(optional)),
        notes=tuple(draw(st.lists(names, max_size=2))),
        bodies=everybody,
        joints=tuple(
            Joint(name=f"j{i}", kind="revolute", body=body_names[0], limits=(-1.0, 1.0))
            for i in range(joints)
        ),
    )

    def column(width):
        return rng.normal(size=(frames, width)).astype(np.float32)

    channels = draw(st.sets(st.tuples(st.sampled_from(body_names), names), max_size=2))
    saved = draw(st.sets(st.integers(0, frames - 1), max_size=2))
    return Episode(
        header=header,
        t=t,
        tracks={body.name: random_track(rng, frames if body.movable else 1) for body in everybody},
        _contacts=random_contacts(rng, header, frames, draw(st.integers(0, 6 * frames))),
        _frames=RobotFrames(
            column(joints),
            column(joints),
            column(draw(st.sampled_from([0, joints]))),
            column(draw(st.sampled_from([0, 8]))),
            column(draw(st.integers(0, 1))),
        ),
        meshes=meshes,
        channels={key: column(1)[:, 0] for key in sorted(channels)},
        states={frame: rng.normal(size=7) for frame in sorted(saved)},
        attachments=draw(st.dictionaries(st.just("task.toml"), st.binary(max_size=40))),
    )
