"""Recordings of others in their own layouts, one of whose files is hurt; what is imported must be sound.

A file without checksums that says something else is another sound source. Damage, whose verdicts are
compared with the sound source's, is what is gone, cut off or no number any more, and whatever happens to bytes
that have a checksum.
"""

from __future__ import annotations

import gzip
import io
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import numpy as np
from bags import ARM, TF_MESSAGE, as_sqlite, ros_transform
from exports import map_text, write_lerobot, write_maniskill, write_robolab
from foreign_demos import demo_file, scene, settled
from hurt import hurt, rewrite
from mcap.writer import CompressionType, Writer
from mcap_ros2.writer import Writer as RosWriter
from oracle import judged, sound
from outcome import Outcome
from rlds_sets import write_rlds
from seeds import plain_episode

from safestage_eval.errors import InputError
from safestage_eval.formats import discover, validate
from safestage_eval.importers import Settings, import_all, load_map
from safestage_eval.importers.calvin import IDS
from safestage_eval.rules import load_rules

FRAMES, STEP = 6, 50_000_000
"""Messages of transforms, and ns between them."""


class Layout(NamedTuple):
    """How others store recordings: what reads it, and what writes a sound source into a folder.

    ``write`` gives the sources, which are the same recording, and the text of a map file.
    """

    name: str
    read_by: tuple[str, ...]
    write: Callable[[Path], tuple[list[Path], str]]


class Import:
    """Sources in one layout."""

    def __init__(self, layout: Layout, folder: Path) -> None:
        self.folder, self.seed = folder, folder / "seed"
        self.seed.mkdir(parents=True)
        self.sources, text = layout.write(self.seed)
        (folder / "map.toml").write_text(text)
        self.settings = Settings(map=load_map(folder / "map.toml"), assets=(self.seed,))
        self.rules = load_rules([Path(__file__).with_name("imports.toml")])
        self.wholes = []
        for i, source in enumerate(self.sources):
            outcome = import_all(source, folder / f"sound{i}", self.settings)
            assert outcome.imported and not outcome.failed, outcome.failed
            self.wholes.append(sound(discover(folder / f"sound{i}")[0], self.rules))

    def again(self) -> list[Outcome]:
        """Each source written again by its codecs."""
        found = []
        for which in range(len(self.sources)):
            path, source = self._copied(which)
            rewrite(path)
            found.append(self._judged(which, source, "again", damage=False))
        return found

    def run(self, rng: Random) -> Outcome:
        """One input."""
        which = rng.randrange(len(self.sources))
        path, source = self._copied(which)
        beside = source if source.is_dir() else source.parent
        what, damage = hurt(rng, path if len(self.sources) == 1 else beside)
        check = rng.random() < 0.2
        try:
            outcome = self._judged(which, source, what, damage=damage)
        except InputError as error:
            return Outcome("problem", what, str(error)[:300])
        out = self.folder / "out"
        if check and outcome.kind != "problem" and (problems := validate(out)):
            return Outcome("changed", what, f"imported, and broken: {problems[0]}")
        return outcome

    def _copied(self, which: int) -> tuple[Path, Path]:
        """A copy of all files, and of one of the sources."""
        path = self.folder / "input"
        shutil.rmtree(path, ignore_errors=True)
        shutil.copytree(self.seed, path)
        return path, path / self.sources[which].relative_to(self.seed)

    def _judged(self, which: int, source: Path, what: str, *, damage: bool) -> Outcome:
        out = self.folder / "out"
        shutil.rmtree(out, ignore_errors=True)
        for failed in import_all(source, out, self.settings).failed:
            kind = "unforeseen" if "bug in the" in failed.message else "problem"
            return Outcome(kind, what, failed.message[:300])
        return judged(out, self.wholes[which], what, self.rules, damage=damage)


def _robolab(folder: Path) -> tuple[list[Path], str]:
    return [write_robolab(folder, [plain_episode()])], map_text(plain_episode())


def _maniskill(folder: Path) -> tuple[list[Path], str]:
    return [write_maniskill(folder / "run", plain_episode())], map_text(plain_episode())


def _lerobot(folder: Path) -> tuple[list[Path], str]:
    source, columns = write_lerobot(folder / "set", [plain_episode()])
    return [source], map_text(plain_episode()) + columns


def _rlds(folder: Path) -> tuple[list[Path], str]:
    source, columns = write_rlds(folder / "set", [plain_episode()])
    return [source], map_text(plain_episode()) + columns


TABLE = """<robot name="t"><link name="base_link"><collision><origin xyz="0 0 0.5"/>
<geometry><box size="1 1 0.1"/></geometry></collision></link>
<link name="drawer_link"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
<joint name="base__drawer" type="prismatic"><parent link="base_link"/><child link="drawer_link"/>
<origin xyz="0.225 0 0.4"/><axis xyz="0 -1 0"/><limit lower="0" upper="0.275"/></joint></robot>"""


def _calvin(folder: Path) -> tuple[list[Path], str]:
    """A file for each frame: a block that is pushed over the furniture, and an arm above."""
    (folder / "calvin_table_A.urdf").write_text(TABLE)
    source = folder / "validation"
    source.mkdir()
    for number in range(24):
        blocks, robot = np.zeros(24), np.zeros(15)
        for block in range(3):
            blocks[6 + 6 * block : 12 + 6 * block] = [0.2 * block, 0, 0.57, 0, 0, 0.3 * block]
        blocks[6] += 0.002 * number
        robot[:3], robot[6], robot[7:14] = (0.1, 0, 0.8), 0.04, 0.01 * number
        frame = {"scene_obs": blocks, "robot_obs": robot, "actions": np.zeros(7)}
        np.savez_compressed(source / f"episode_{number:07d}.npz", **frame)
    np.save(source / IDS, np.array([[0, 23]]))
    return [source], '[source]\nscene = "A"\n[every.roles]\ntarget = ["block_pink"]\n'


def _ros(folder: Path) -> tuple[list[Path], str]:
    """A cube that moves, a table, and an arm with its description."""
    file = folder / "run0/run.mcap"
    file.parent.mkdir()
    file.write_bytes(_in_cdr())
    return [file], map_text(plain_episode())


def _in_cdr() -> bytes:
    out, still = io.BytesIO(), (1, 0, 0, 0)
    writer = RosWriter(out, compression=CompressionType.LZ4)
    text = writer.register_msgdef("std_msgs/msg/String", "string data")
    writer.write_message("/robot_description", text, {"data": ARM}, 0, 0)
    tf = writer.register_msgdef("tf2_msgs/msg/TFMessage", TF_MESSAGE)
    fixed = [ros_transform(0, "map", "table", (0, 0, -0.02), still)]
    writer.write_message("/tf_static", tf, {"transforms": fixed}, 0, 0)
    for n in range(FRAMES):
        moving = [
            ros_transform(n * STEP, "map", "cube", plain_episode().tracks["cube"].position[n], still),
            ros_transform(n * STEP, "map", "upper", (0, 0, 0.3), still),
            ros_transform(n * STEP, "upper", "hand", (0, 0, 0.4), still),
        ]  # fmt: skip
        writer.write_message("/tf", tf, {"transforms": moving}, n * STEP, n * STEP)
    writer.finish()
    return out.getvalue()


def _sqlite(folder: Path) -> tuple[list[Path], str]:
    twin = folder.parent / "twin.mcap"
    twin.write_bytes(_in_cdr())
    (folder / "run0").mkdir()
    return [as_sqlite(twin, folder / "run0/run_0.db3")], map_text(plain_episode())


def transforms() -> dict[str, Any]:
    """Foxglove's messages: a cube that moves, a table, and the cube's shape in a scene."""
    none = {"x": 0.0, "y": 0.0, "z": 0.0}
    here = {"position": none, "orientation": {**none, "w": 1.0}}
    size = {"x": 0.04, "y": 0.04, "z": 0.04}
    points = [size, none, {**none, "y": 1.0}, {**none, "z": 1.0}]
    triangles = {"pose": here, "points": points, "indices": [0, 1, 2, 0, 2, 3, 0, 1, 3, 1, 2, 3]}
    entity = {
        "id": "cube", "frame_id": "cube", "frame_locked": True,
        "cubes": [{"pose": here, "size": size}], "spheres": [{"pose": here, "size": size}],
        "cylinders": [{"pose": here, "size": size, "bottom_scale": 1.0, "top_scale": 1.0}],
        "triangles": [triangles],
    }  # fmt: skip
    moving = [
        [
            {
                "timestamp": {"seconds": 0, "nanos": n * STEP},
                "parent_frame_id": "map", "child_frame_id": name,
                "translation": {**none, "x": 0.01 * n * (name == "cube"), "z": 0.02},
                "rotation": {**none, "w": 1.0},
            }
            for name in ("cube", "table")
        ]
        for n in range(FRAMES)
    ]  # fmt: skip
    return {"scene": {"entities": [entity]}, "tf": moving}


def in_json(messages: dict[str, Any]) -> bytes:
    """An MCAP file of such messages in JSON."""
    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType.LZ4)
    writer.start()
    said = [("/scene", 0, messages["scene"])]
    said += [("/tf", n * STEP, {"transforms": one}) for n, one in enumerate(messages["tf"])]
    channels = {}
    for topic, name in (("/tf", "foxglove.FrameTransforms"), ("/scene", "foxglove.SceneUpdate")):
        schema = writer.register_schema(name, "jsonschema", b"{}")
        channels[topic] = writer.register_channel(topic, "json", schema)
    for topic, now, message in said:
        writer.add_message(channels[topic], now, json.dumps(message).encode(), now)
    writer.finish()
    return out.getvalue()


def _foxglove(folder: Path) -> tuple[list[Path], str]:
    file = folder / "run0/run.mcap"
    file.parent.mkdir()
    file.write_bytes(in_json(transforms()))
    return [file], map_text(plain_episode())


BODIES = """
<body name="robot0_base" pos="0.4 0 0.1">
  <geom type="capsule" size="0.03 0.05" mass="1"/>
  <body name="robot0_link" pos="0 0 0.1"><joint name="robot0_joint1" type="hinge" axis="0 1 0"/>
    <geom name="finger" type="box" size="0.01 0.01 0.03" mass="0.1"/></body>
</body>
<body name="bin" pos="-0.4 0 0"><geom type="box" size="0.1 0.1 0.01"/>
  <geom type="ellipsoid" size="0.02 0.03 0.04" pos="0 0 0.1"/></body>
"""
REST = """
<asset><mesh name="hull" vertex="0 0 0 0.1 0 0 0 0.1 0 0 0 0.1"/></asset>
<actuator><motor joint="robot0_joint1"/></actuator>
<contact><exclude body1="robot0_base" body2="bin"/></contact>
<equality><weld body1="cube" body2="bin" active="false"/></equality>
"""


def _states(folder: Path) -> tuple[list[Path], str]:
    """MuJoCo's states as robosuite and as RoboCasa store them."""
    model = scene(bodies=BODIES, rest=REST)
    states = settled(model, rows=12)
    (folder / "hdf5").mkdir()
    args = json.dumps({"env_kwargs": {"control_freq": 20}})
    demo = demo_file(
        folder / "hdf5/demo.hdf5", model, states, about={"env": "Lift", "env_args": args},
        actions=np.zeros((12, 7)), rewards=np.array([0.0] * 11 + [1.0]),
    )  # fmt: skip
    extras = folder / "npz/extras/episode_000001"
    extras.mkdir(parents=True)
    np.savez(extras / "states.npz", states=states)
    (extras / "model.xml.gz").write_bytes(gzip.compress(model.encode()))
    (extras / "ep_meta.json").write_text(json.dumps({"lang": "lift it"}))
    (extras.parent / "dataset_meta.json").write_text(args)
    return [demo, folder / "npz"], '[every]\ntask = "Push"\nroles = { target = ["cube"] }\n'


LAYOUTS = {
    "robolab": Layout("RoboLab and Isaac Lab HDF5", ("h5py",), _robolab),
    "maniskill": Layout("ManiSkill", ("h5py",), _maniskill),
    "lerobot": Layout("LeRobot", ("pyarrow",), _lerobot),
    "rlds": Layout("RLDS", ("protobuf",), _rlds),
    "calvin": Layout("CALVIN", ("numpy",), _calvin),
    "ros": Layout("ROS 2 bag", ("mcap", "mcap-ros2-support"), _ros),
    "foxglove": Layout("Foxglove transforms", ("mcap",), _foxglove),
    "sqlite": Layout("ROS 2 bag in SQLite", ("rosbags",), _sqlite),
    "mujoco": Layout("MuJoCo states", ("h5py", "mujoco"), _states),
}


def _target(layout: Layout) -> type[Import]:
    class Target(Import):
        name, read_by = layout.name, layout.read_by

        def __init__(self, folder: Path) -> None:
            super().__init__(layout, folder)

    return Target


IMPORTS = {key: _target(layout) for key, layout in LAYOUTS.items()}
