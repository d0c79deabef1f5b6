"""A foreign simulator's own answers at each state that its collector stored."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import h5py
import mujoco
import numpy as np
from scipy.spatial import ConvexHull

MANY_FACES, COARSE = 500, 1e-3
"""A hull with so many faces is made of corners rounded to so many metres."""


class Truth:
    """Collects contacts, forces and poses from the source's own full model, meshes and all.

    The state of a stored row is put into a second ``MjData`` with the command that was in force:
    what the running simulator holds lags by one physics step.
    """

    def __init__(self, model: mujoco.MjModel, version: str) -> None:
        """``version``: of the simulator."""
        self._model, self._data = model, mujoco.MjData(model)
        self._version = version
        self._rows: list[np.ndarray] = []
        self._poses: list[np.ndarray] = []
        self._pairs: list[tuple[int, int, int, float]] = []

    def note(self, state: np.ndarray, ctrl: np.ndarray) -> None:
        """``state``: time, qpos, qvel."""
        model, data, frame = self._model, self._data, len(self._rows)
        data.time, data.ctrl[:] = state[0], ctrl
        data.qpos[:], data.qvel[:] = np.split(state[1:], [model.nq])
        data.qacc_warmstart[:] = 0
        mujoco.mj_forward(model, data)
        self._rows.append(state.copy())
        self._poses.append(np.hstack([data.xpos, data.xquat]))
        for i in range(data.ncon):
            contact = data.contact[i]
            if contact.dist > 0:
                continue
            force = np.zeros(6)
            mujoco.mj_contactForce(model, data, i, force)
            self._pairs.append((frame, int(contact.geom1), int(contact.geom2), float(force[0])))

    def save(self, path: Path) -> None:
        """Body and geom names, poses (T, nbody, 7), contacts that overlap with N normal force."""
        model = self._model
        rows = np.array(self._pairs)
        geoms = rows[:, 1:3].astype(int)
        np.savez_compressed(
            path,
            simulator=self._version,
            mujoco=mujoco.__version__,
            states=np.array(self._rows),
            bodies=[model.body(i).name for i in range(model.nbody)],
            mass=model.body_mass,
            poses=np.array(self._poses).astype(np.float32),
            frame=rows[:, 0].astype(np.int32),
            body=model.geom_bodyid[geoms].astype(np.int16),
            normal=rows[:, 3].astype(np.float32),
        )


def without_visuals(text: str) -> str:
    """The model without the meshes, textures and materials that are only seen.

    What they weigh stays: each body is given the mass and inertia that it has with them.
    """
    root = ET.fromstring(text)
    model = mujoco.MjModel.from_xml_string(text)
    for body in root.iter("body"):
        i = model.body(body.get("name")).id
        if body.find("inertial") is None and model.body_mass[i] > 0:
            said = {
                "pos": model.body_ipos[i], "quat": model.body_iquat[i],
                "diaginertia": model.body_inertia[i], "mass": model.body_mass[i : i + 1],
            }  # fmt: skip
            words = {key: " ".join(repr(float(x)) for x in value) for key, value in said.items()}
            body.insert(0, ET.Element("inertial", words))
    for parent in list(root.iter()):
        for geom in parent.findall("geom"):
            seen = geom.get("contype") == "0" and geom.get("conaffinity") == "0"
            if seen and geom.get("type") == "mesh":
                parent.remove(geom)
            geom.attrib.pop("material", None)
    used = {geom.get("mesh") for geom in root.iter("geom")}
    for assets in root.iter("asset"):
        for asset in list(assets):
            if asset.tag in ("texture", "material") or asset.get("name") not in used:
                assets.remove(asset)
    return ET.tostring(root, encoding="unicode")


def clear(folder: Path) -> None:
    """Remove what an earlier recording left; licences and notices stay."""
    for name in ("demo.hdf5", "truth.npz"):
        (folder / name).unlink(missing_ok=True)
    for mesh in folder.rglob("*.stl"):
        mesh.unlink()
    folder.mkdir(parents=True, exist_ok=True)


def keep_collision_meshes(demo: Path, to: Path) -> None:
    """Copy the meshes that can touch, as convex hulls, under the end of the path they are named by.

    MuJoCo collides the hull of a mesh alone, so nothing is lost but size.
    """
    with h5py.File(demo) as file:
        texts = [group.attrs["model_file"] for group in file["data"].values()]
    for text in texts:
        model = mujoco.MjModel.from_xml_string(text)
        named = dict(re.findall(r'<mesh name="([^"]+)"[^>]* file="([^"]+)"', text))
        for geom in range(model.ngeom):
            mesh = int(model.geom_dataid[geom])
            touches = model.geom_contype[geom] or model.geom_conaffinity[geom]
            if mesh < 0 or not touches or model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
                continue
            source = Path(named[model.mesh(mesh).name])
            place = to / Path(*source.parts[-3:])
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(_hull(source))


def shorten_paths(demo: Path) -> None:
    """Let the files that a model names be of no machine in particular."""
    with h5py.File(demo) as old, h5py.File(demo.with_suffix(".new"), "w") as new:
        data = new.create_group("data")
        data.attrs.update(old["data"].attrs)
        for name, group in old["data"].items():
            copy = data.create_group(name)
            for key, value in group.items():
                copy.create_dataset(key, data=value[()])
            for key, value in group.attrs.items():
                plain = re.sub(r'file="[^"]*/site-packages/', 'file="/packages/', str(value))
                copy.attrs[key] = plain if key == "model_file" else value
    demo.with_suffix(".new").replace(demo)


def _hull(source: Path) -> bytes:
    """A binary STL of the convex hull of another, in its own frame and scale."""
    triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    given = np.frombuffer(source.read_bytes(), triangle, offset=84)["corners"].reshape(-1, 3)
    hull = ConvexHull(given)
    if len(hull.simplices) > MANY_FACES:
        hull = ConvexHull(np.unique(np.round(given / COARSE) * COARSE, axis=0))
    faces = hull.points[hull.simplices]
    turned = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    wrong = np.einsum("ij,ij->i", turned, hull.equations[:, :3]) < 0
    faces[wrong] = faces[wrong][:, ::-1]
    out = np.zeros(len(faces), triangle)
    out["normal"], out["corners"] = hull.equations[:, :3], faces
    return b"\0" * 80 + np.uint32(len(faces)).tobytes() + out.tobytes()
