"""A foreign MJCF text into a model for physics alone: what is only seen is left out."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath, PureWindowsPath

import mujoco

from safestage_eval.errors import InputError
from safestage_eval.importers.importer import SourceError
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
        xml: MJCF of it, and ``assets``, the files that it names.
    """

    model: mujoco.MjModel
    unweighed: tuple[str, ...] = ()
    drawn: frozenset[str] = frozenset()
    xml: str = ""
    assets: Mapping[str, bytes] = field(default_factory=dict)


def load_model(text: str, where: str, assets: Sequence[Path] = ()) -> Loaded:
    """Compile a model without its visual meshes, textures, materials and skins.

    A visual mesh may be what gives a body its mass, where the file says none: by an amount that
    depends on the version of MuJoCo. Such a body then weighs what its other shapes do.

    Args:
        text: MJCF as the source stored it; its files may be of another machine.
        where: as messages say it.
        assets: folders in which files are looked for by the end of their path.

    Raises:
        InputError: it is no MJCF that MuJoCo can read.
        SourceError: the file of a collision shape is not there.
    """
    try:
        spec = mujoco.MjSpec.from_string(_plain(text, where))
        needed, unweighed, drawn = _strip(spec)
    except UNREADABLE as error:
        raise InputError(where, f"MuJoCo cannot read the model: {_line(error)}.") from None
    spec.assets = files = _files(spec, needed, where, assets)
    try:
        model = spec.compile()
        written = spec.to_xml()
    except UNREADABLE as error:
        raise InputError(where, f"MuJoCo cannot compile the model: {_line(error)}.") from None
    if model.nflex:
        raise InputError(where, "the model has soft bodies (flex), which no trace can hold.")
    return Loaded(model, unweighed, drawn, _for_older(written), files)


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


def _strip(spec: mujoco.MjSpec) -> tuple[dict[str, str], tuple[str, ...], frozenset[str]]:
    """Remove what is only seen.

    Returns the meshes that are left, each with a geom that needs it, the bodies whose mass went
    with what was removed, and those from which anything was removed.
    """
    needed: dict[str, str] = {}
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
                needed[geom.meshname] = f"geom {geom.name!r} of body {body.name!r}"
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
    return needed, tuple(unweighed), frozenset(drawn)


def _files(
    spec: mujoco.MjSpec, needed: dict[str, str], where: str, assets: Sequence[Path]
) -> dict[str, bytes]:
    """Name → content of the files of meshes and height fields, which are renamed to these names."""
    out: dict[str, bytes] = {}
    missing: list[str] = []
    named = [(mesh, spec.meshdir, needed[mesh.name]) for mesh in spec.meshes]
    named += [(field, spec.meshdir, f"height field {field.name!r}") for field in spec.hfields]
    for element, folder, user in named:
        if not element.file:
            continue
        file = _find(element.file, folder, assets)
        if file is None:
            missing.append(f"{element.file} ({user})")
            continue
        name = f"{len(out)}{Path(element.file).suffix.lower()}"
        out[name], element.file = file.read_bytes(), name
    spec.meshdir = ""
    if missing:
        looked = ", ".join(map(str, assets)) or "its own path"
        more = f", and {len(missing) - 1} more" if len(missing) > 1 else ""
        raise SourceError(
            where,
            f"a shape that collides needs {missing[0]}{more}: not found in {looked}.",
            fix=FIX,
        )
    return out


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
