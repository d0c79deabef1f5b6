"""Compares recordings with what the simulator itself says, in the simulator's own environment.

    python benchmarks/record_peers.py ENVIRONMENT [STEPS] > peers/NAME.json   # there, recorder/ on PYTHONPATH
    python benchmarks/record_peers.py --write docs/recorder_accuracy.md peers/*.json   # anywhere

A witness looks after every physics step, by the simulator's own functions one body and one contact at a
time; the recording is read as a ZIP of arrays. Poses, the pairs that touch at every frame, the sum of each pair's
forces there, and the largest of the physics steps since the frame before are compared.
"""

from __future__ import annotations

import io
import json
import platform
import sys
import tempfile
import zipfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import safestage_record
from peer_envs import ENVIRONMENTS
from safestage_record.find_backend import find_backend

PACKAGES = {"gymnasium_robotics": "gymnasium-robotics", "dm_control": "dm-control"}
NAMES = {
    "robosuite": "robosuite {}, Lift",
    "gymnasium_robotics": "Gymnasium-Robotics {}, pick and place",
    "metaworld": "Meta-World {}, pick-place-v3",
    "dm_control": "dm_control {}, bring_ball",
    "mani_skill": "ManiSkill {}, PickCube",
    "pybullet": "PyBullet {}, KUKA, cube and duck",
}
BEGIN, END = "<!-- measured: record_peers.py -->", "<!-- end -->"

Pairs = "dict[tuple[str, str], tuple[float, Any]]"


class MujocoWitness:
    """By MuJoCo's own functions."""

    of_moment_before = True

    def __init__(self, found: Any) -> None:
        import mujoco

        self.mujoco, (self.model, self.data), self.steps = mujoco, found, []
        self.names = safestage_record.model_scene.body_names(self.model)
        self.step = mujoco.mj_step
        self.second = mujoco.mj_step2
        mujoco.mj_step, mujoco.mj_step2 = self, self.second_half

    def second_half(self, model: Any, data: Any) -> None:
        """Step and look, where a step is taken in two halves, as dm_control does."""
        time = data.time
        self.second(model, data)
        if data is self.data:
            self.look(time)

    def __call__(self, model: Any, data: Any, nstep: int = 1) -> None:
        """Step and look."""
        for _ in range(nstep):
            time = data.time
            self.step(model, data)
            if data is self.data:
                self.look(time)

    def look(self, time: float) -> None:
        """Keep time, pose by body and force by pair."""
        data, names = self.data, self.names
        poses = {n: np.append(data.xpos[i], data.xquat[i]) for i, n in enumerate(names)}
        pairs: dict[Any, list[Any]] = {}
        force = np.zeros(6)
        every = data.contact
        for i in range(data.ncon):
            if every.efc_address[i] < 0:
                continue
            self.mujoco.mj_contactForce(self.model, data, i, force)
            if force[0] <= 0 and every.dist[i] > 0:
                continue
            g1, g2 = int(data.contact[i].geom1), int(data.contact[i].geom2)
            a, b = names[self.model.geom_bodyid[g1]], names[self.model.geom_bodyid[g2]]
            add(pairs, a, b, force[0], every.frame[i].reshape(3, 3).T @ force[:3])
        self.steps.append((time, poses, pairs))


class SapienWitness:
    """By SAPIEN's own contacts and poses."""

    of_moment_before = False

    def __init__(self, scene: Any) -> None:
        self.scene, self.steps = scene, []
        kind = type(scene.physx_system)
        step, dt = kind.step, round(float(scene.timestep), 8)

        def tell(system: Any) -> None:
            step(system)
            self.look(dt * (len(self.steps) + 1), dt)

        kind.step = tell

    def look(self, time: float, dt: float) -> None:
        """Keep time, pose by body and force by pair."""
        poses, pairs = {}, {}
        for entity in self.scene.entities:
            pose = entity.pose
            poses[plain(entity.name)] = np.concatenate([pose.p, pose.q])
        for contact in self.scene.get_contacts():
            a, b = (plain(body.entity.name) for body in contact.bodies)
            for point in contact.points:
                size = float(np.linalg.norm(point.impulse))
                if size > 0 or point.separation <= 0:
                    add(pairs, b, a, size / dt, point.impulse / dt)
        self.steps.append((time, poses, pairs))


class BulletWitness:
    """By PyBullet's own functions."""

    of_moment_before = False

    def __init__(self, client: int) -> None:
        import pybullet

        self.p, self.client, self.steps = pybullet, client, []
        step = pybullet.stepSimulation

        def tell(physicsClientId: int = 0) -> None:
            step(physicsClientId=physicsClientId)
            self.look()

        pybullet.stepSimulation = tell

    def name(self, body: int, link: int) -> str:
        """Name as in the trace."""
        base = Path(self.p.getBodyInfo(body, physicsClientId=self.client)[1].decode()).stem
        count = self.p.getNumBodies(physicsClientId=self.client)
        names = [
            Path(self.p.getBodyInfo(i, physicsClientId=self.client)[1].decode()).stem
            for i in range(count)
        ]
        base = f"{base}_{body}" if base in names[:body] else base
        if link < 0:
            return base
        info = self.p.getJointInfo(body, link, physicsClientId=self.client)
        return f"{base}_{info[12].decode()}".replace("/", "_")

    def look(self) -> None:
        """Keep time, pose by body and force by pair."""
        p, client = self.p, self.client
        poses, pairs = {}, {}
        for body in range(p.getNumBodies(physicsClientId=client)):
            about = p.getDynamicsInfo(body, -1, physicsClientId=client)
            place, turned = p.getBasePositionAndOrientation(body, physicsClientId=client)
            back = p.invertTransform(about[3], about[4])
            place, turned = p.multiplyTransforms(place, turned, *back)
            poses[self.name(body, -1)] = np.array([*place, turned[3], *turned[:3]])
            for link in range(p.getNumJoints(body, physicsClientId=client)):
                state = p.getLinkState(body, link, 0, 1, physicsClientId=client)
                q = state[5]
                poses[self.name(body, link)] = np.array([*state[4], q[3], *q[:3]])
        for c in p.getContactPoints(physicsClientId=client):
            if c[9] > 0 or c[8] <= 0:
                push = c[9] * np.array(c[7]) + c[10] * np.array(c[11]) + c[12] * np.array(c[13])
                add(pairs, self.name(c[2], c[4]), self.name(c[1], c[3]), c[9], push)
        dt = p.getPhysicsEngineParameters(physicsClientId=client)["fixedTimeStep"]
        self.steps.append((dt * (len(self.steps) + 1), poses, pairs))


WITNESSES = {"mujoco": MujocoWitness, "sapien": SapienWitness, "pybullet": BulletWitness}


def plain(name: str) -> str:
    """ManiSkill's name without the number of its scene."""
    head, _, tail = name.partition("_") if "_" in name else ("", "", name)
    return tail if head == "scene-0" else name


def add(pairs: Any, first: str, second: str, normal: float, push: Any) -> None:
    """Add a contact's normal force and its force on the second body."""
    sign = 1.0 if first < second else -1.0
    entry = pairs.setdefault(tuple(sorted((first, second))), [0.0, np.zeros(3)])
    entry[0] += float(normal)
    entry[1] = entry[1] + sign * np.asarray(push, float)


def compare(path: Path, witness: Any) -> dict[str, Any]:
    """Return what differs between a recording and its witness."""
    with zipfile.ZipFile(path) as archive:
        header = json.loads(archive.read("safestage.json"))["header"]
        arrays = {
            n[:-4]: np.lib.format.read_array(io.BytesIO(archive.read(n)))
            for n in archive.namelist()
            if n.endswith(".npy")
        }
    moving = [body["name"] for body in header["bodies"] if body["movable"]]
    owner = [body["name"] for body in header["bodies"] for _ in body["geoms"]]
    times = np.array([step[0] for step in witness.steps])
    start = times[0] if witness.of_moment_before else 0.0
    ends = np.concatenate([[0], np.cumsum(arrays["counts"])])
    out = {"frames": 0, "pairs": 0, "wrong": 0, "pose": 0.0, "force": 0.0, "peak": 0.0}
    last = None
    for k, t in enumerate(arrays["t"] + start):
        now = int(np.argmin(np.abs(times - t)))
        if abs(times[now] - t) > 1e-6:
            continue  # the frame of the beginning, of which no step told
        _, poses, pairs = witness.steps[now]
        out["frames"] += 1
        for i, name in enumerate(moving):
            mine = np.append(arrays["position"][i, k], arrays["orientation"][i, k])
            theirs = poses[name]
            far = min(np.abs(mine[3:] - theirs[3:]).max(), np.abs(mine[3:] + theirs[3:]).max())
            out["pose"] = max(out["pose"], float(np.abs(mine[:3] - theirs[:3]).max()), float(far))
        if last is None:
            last = now - 1 if witness.of_moment_before else now
            continue
        mine_pairs: dict[Any, list[Any]] = {}
        for row in arrays["contacts"][ends[k] : ends[k + 1]]:
            a, b = owner[row["geom1"]], owner[row["geom2"]]
            add(mine_pairs, a, b, 0.0, row["force"])
            mine_pairs[tuple(sorted((a, b)))][0] = float(row["peak_force"])
        between: dict[Any, float] = {}
        for step in witness.steps[last + 1 : now + 1]:
            for pair, (normal, _) in step[2].items():
                between[pair] = max(between.get(pair, 0.0), normal)
        out["pairs"] += len(between)
        out["wrong"] += len(set(between) ^ set(mine_pairs))
        for pair in set(between) & set(mine_pairs):
            theirs = pairs.get(pair, [0.0, np.zeros(3)])[1]
            scale = max(float(np.linalg.norm(theirs)), 1e-2)
            off = float(np.linalg.norm(mine_pairs[pair][1] - theirs)) / scale
            out["force"] = max(out["force"], off)
            scale = max(between[pair], 1e-2)
            out["peak"] = max(out["peak"], abs(mine_pairs[pair][0] - between[pair]) / scale)
        last = now
    return out


def main() -> None:
    """Record and compare, or write the table."""
    if sys.argv[1] == "--write":
        write(Path(sys.argv[2]), [json.loads(Path(p).read_text()) for p in sys.argv[3:]])
        return
    name, steps = sys.argv[1], int((sys.argv[2:] or ["100"])[0])
    env, draw = ENVIRONMENTS[name]()
    rng = np.random.default_rng(0)
    folder = Path(tempfile.mkdtemp())
    env.reset()
    backend, found = find_backend(env)
    witness = WITNESSES[backend](found)  # before the recorder, so that it sees the step first
    recorder = safestage_record.find_backend.begin_recording(env, folder / "t.zip")
    for _ in range(steps):
        action = draw(rng)
        env.step(action)
        recorder.step(action)
    recorder.close()
    engine = {"mujoco": "mujoco", "sapien": "sapien", "pybullet": "pybullet"}[backend]
    row = {
        "name": NAMES[name].format(version(PACKAGES.get(name, name))),
        "python": platform.python_version().rpartition(".")[0],
        "engine": f"{recorder.simulator} {version(engine)}",
        **compare(folder / "t.zip", witness),
    }
    print(json.dumps(row))
    print(recorder.tells(), file=sys.stderr)


def write(page: Path, rows: list[dict[str, Any]]) -> None:
    """Put the table between its marks."""
    lines = [
        BEGIN,
        "| environment | Python, engine | frames | pairs that touch | wrong | pose | force | peak force |",
        "|---|---|---|---|---|---|---|---|",
        *(
            f"| {r['name']} | {r['python']}, {r['engine']} | {r['frames']} | {r['pairs']} | {r['wrong']} "
            f"| {r['pose']:.0e} | {r['force']:.0e} | {r['peak']:.0e} |"
            for r in rows
        ),
        END,
    ]
    text = page.read_text()
    head, _, rest = text.partition(BEGIN)
    page.write_text(head + "\n".join(lines) + rest.partition(END)[2])


if __name__ == "__main__":
    main()
