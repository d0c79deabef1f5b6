"""A foreign MJCF text into a model for physics alone: what is only seen is left out."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath, PureWindowsPath

import mujoco

from safestage_eval.errors import InputError
from safestage_eval.size_limits import current

SHAPES = (".obj", ".stl", ".msh", ".ply", ".png", ".bin", ".hf")
"""Endings of meshes and height fields: what a model may name by its own path."""

FIX = "--assets DIR, a folder that has it: the sources or the installed package of the simulator"

OBSOLETE = {
    "option": ("collision", "apirate", "mpr_iterations", "mpr_tolerance"),
    "compiler": ("convexhull", "exactmeshinertia", "coordinate"),
    "size": ("njmax", "nconmax", "nstack"),
}
"""Attributes of older MuJoCo versions that newer ones refuse, and that do not change the physics."""

UNREADABLE = (ValueError, RuntimeError, mujoco.FatalError, mujoco.UnexpectedError)
"""Exceptions of MuJoCo on models that it cannot use: some faults are only its "unknown exception"."""

ONLY_SEEN = ("visual", "statistic", "keyframe", "sensor", "custom")
"""Sections that no contact depends on."""


@dataclass(frozen=True)
class Loaded:
    """A model for physics alone.

    Attributes:
        model: compiled.
        unweighed: bodies whose mass the file has from visual meshes, which are not in the model.
        drawn: bodies that had visual meshes.
        lost: files of shapes that collide and are nowhere to be found; ``shapeless``, bodies that have
            some, and are left without any shape.
        looked: where the files were looked for.
        xml: MJCF of it, and ``assets``, the files that it names.
    """

    model: mujoco.MjModel
    unweighed: tuple[str, ...] = ()
    drawn: frozenset[str] = frozenset()
    lost: tuple[str, ...] = ()
    shapeless: frozenset[str] = frozenset()
    looked: str = ""
    xml: str = ""
    assets: Mapping[str, bytes] = field(default_factory=dict)


def load_model(text: str, where: str, assets: Sequence[Path] = ()) -> Loaded:
    """Compile a model without its visual meshes, textures, materials and skins.

    A visual mesh may be what gives a body its mass, where the file says none: by an amount that
    depends on the version of MuJoCo. Such a body then weighs what its other shapes do.

    A body of which the file of a shape is not there is left without shapes.

    Args:
        text: MJCF as the source stored it; its files may be of another machine.
        where: as messages say it.
        assets: folders in which files are looked for by the end of their path.

    Raises:
        InputError: it is no MJCF that MuJoCo can read.
    """
    try:
        spec = mujoco.MjSpec.from_string(_plain(text, where))
        unweighed, drawn = _strip(spec)
    except UNREADABLE as error:
        raise InputError(where, f"MuJoCo cannot read the model: {_line(error)}.") from None
    files, lost = _files(spec, assets)
    spec.assets = files
    shapeless = _without_shapes(spec, lost)
    try:
        model = spec.compile()
        written = spec.to_xml()
    except UNREADABLE as error:
        raise InputError(where, f"MuJoCo cannot compile the model: {_line(error)}.") from None
    if model.nflex:
        raise InputError(where, "the model has soft bodies (flex), which no trace can hold.")
    looked = ", ".join(map(str, assets)) or "its own path"
    names = tuple(dict.fromkeys(lost.values()))
    return Loaded(model, unweighed, drawn, names, shapeless, looked, _for_older(written), files)


def _for_older(text: str) -> str:
    """MJCF as this MuJoCo writes it, with what older ones take otherwise where it is left out.

    Without lights, which are written in another way today.
    """
    root = ET.fromstring(text)  # noqa: S314 — written by MuJoCo
    for parent in list(root.iter()):
        for light in parent.findall("light"):
            parent.remove(light)
    compiler = root.find("compiler")
    if compiler is None:
        compiler = ET.SubElement(root, "compiler")
    compiler.set("autolimits", "true")
    return ET.tostring(root, encoding="unicode")


def _plain(text: str, where: str) -> str:
    """Without sections that are only seen and attributes that newer versions refuse."""
    current().demand("document", len(text), where)
    try:
        root = ET.fromstring(text)  # noqa: S314 — no external entities are resolved
    except ET.ParseError as error:
        raise InputError(where, f"the model is not XML: {error}.") from None
    if any(element.get("coordinate") == "global" for element in root.iter("compiler")):
        raise InputError(
            where,
            "the model is in global coordinates, which MuJoCo reads no more since 2.3.4.",
            fix="save it with an older MuJoCo (mj_saveLastXML), which writes local ones",
        )
    outside = next((e for tag in ("include", "model") for e in root.iter(tag)), None)
    if outside is not None:
        raise InputError(
            where,
            f"the model takes in another file, {outside.get('file', '')!r}.",
            fix="store the model in one piece, as mj_saveLastXML writes it",
        )
    for name in ONLY_SEEN:
        for element in root.findall(name):
            root.remove(element)
    for tag, attributes in OBSOLETE.items():
        for element in root.iter(tag):
            for attribute in attributes:
                element.attrib.pop(attribute, None)
    return ET.tostring(root, encoding="unicode")


def _strip(spec: mujoco.MjSpec) -> tuple[tuple[str, ...], frozenset[str]]:
    """Remove what is only seen.

    Returns the bodies whose mass went with what was removed, and those from which anything was removed.
    """
    needed: set[str] = set()
    unweighed: dict[str, None] = {}
    drawn: set[str] = set()
    lowest, highest = spec.compiler.inertiagrouprange
    from_geoms = int(spec.compiler.inertiafromgeom)
    for body in spec.bodies:
        inferred = from_geoms == int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE) or (
            from_geoms == int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO)
            and not body.explicitinertial
        )
        for geom in list(body.geoms):
            geom.material = ""
            if not geom.meshname:
                continue
            if geom.contype or geom.conaffinity:
                needed.add(geom.meshname)
                continue
            if inferred and lowest <= geom.group <= highest and geom.mass != 0 and geom.density:
                unweighed[body.name] = None
            drawn.add(body.name)
            spec.delete(geom)
    for kind in (spec.skins, spec.materials, spec.textures):
        for element in list(kind):
            spec.delete(element)
    for mesh in list(spec.meshes):
        if mesh.name not in needed:
            spec.delete(mesh)
    return tuple(unweighed), frozenset(drawn)


def _files(spec: mujoco.MjSpec, assets: Sequence[Path]) -> tuple[dict[str, bytes], dict[str, str]]:
    """Name → content of the files of meshes and height fields, which are renamed to these names.

    And the name of each mesh and height field whose file is not there → that file.
    """
    out: dict[str, bytes] = {}
    lost: dict[str, str] = {}
    for element in (*spec.meshes, *spec.hfields):
        if not element.file:
            continue
        file = _find(element.file, spec.meshdir, assets)
        if file is None:
            lost[element.name] = element.file
            continue
        name = f"{len(out)}{Path(element.file).suffix.lower()}"
        out[name], element.file = file.read_bytes(), name
    spec.meshdir = ""
    return out, lost


def _without_shapes(spec: mujoco.MjSpec, lost: Mapping[str, str]) -> frozenset[str]:
    """Remove the meshes and height fields that are lost, and all shapes of bodies that have one of them.

    With a part of its shapes a body would seem further away than it is.
    """
    bare: set[str] = set()
    for body in spec.bodies:
        geoms = list(body.geoms)
        if not any(geom.meshname in lost or geom.hfieldname in lost for geom in geoms):
            continue
        for geom in geoms:
            spec.delete(geom)
        bare.add(body.name)
        if not body.explicitinertial:  # MuJoCo needs some; poses do not hang on it
            body.explicitinertial, body.mass, body.inertia = True, 1.0, (1.0, 1.0, 1.0)
    for element in (*spec.meshes, *spec.hfields):
        if element.name in lost:
            spec.delete(element)
    return frozenset(bare)


def _find(file: str, folder: str, assets: Sequence[Path]) -> Path | None:
    """By the longest end of its path that one of the folders has, then by the path itself."""
    absolute = PurePosixPath(file).is_absolute() or PureWindowsPath(file).is_absolute()
    full = file if absolute or not folder else f"{folder}/{file}"
    parts = [part for part in re.split(r"[\\/]+", full) if part not in ("", ".", "..")]
    for start in range(len(parts)):
        for root in assets:
            candidate = root.joinpath(*parts[start:])
            if candidate.is_file():
                return candidate
    itself = absolute and Path(full).suffix.lower() in SHAPES and Path(full).is_file()
    return Path(full) if itself else None


def _line(error: Exception) -> str:
    return " ".join(str(error).split()).rstrip(".")
