"""Bodies as the source has them, with what the map file adds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from safestage_eval.episode import Body, Cavity, Episode, Geom, Mesh, Tcp, Track, still_track
from safestage_eval.errors import InputError

from .importer import SourceError
from .map_tables import BodyTable, MapFile, ShapeTable
from .mesh_file import read_mesh

Meshes = dict[str, Mesh]


def apply_map(body: Body, map_: MapFile, meshes: Meshes) -> Body:
    """Return the body with the entries of the map; add meshes of its shapes to ``meshes``.

    Raises:
        InputError: a mesh file that cannot be read, an axis of no length.
    """
    entry = map_.of_body(body.name)
    if entry is None:
        return body
    entry_of = {"up_axis": "up", "cavity": "cavity"}
    untold = tuple(f for f in body.untold if entry_of.get(f) not in entry.model_fields_set)
    fields = _fields(body.name, entry, map_, meshes)
    return body.model_copy(update={**fields, "untold": untold})


def fixed_from_map(
    names: set[str], map_: MapFile, meshes: Meshes
) -> tuple[list[Body], dict[str, Track]]:
    """Return the fixed bodies that only the map has: those with a position, whose name is not in ``names``.

    Raises:
        InputError: as ``apply_map``.
    """
    bodies, tracks = [], {}
    for name, entry in map_.body.items():
        if name in names or entry.position is None:
            continue
        fields = {"kind": "fixture", **_fields(name, entry, map_, meshes), "movable": False}
        bodies.append(Body(name=name, **fields))
        tracks[name] = still_track(entry.position, _unit(entry.orientation, name))
    return bodies, tracks


def in_metres(episode: Episode, map_: MapFile) -> Episode:
    """Return the episode with the source's lengths in metres, if the map file says what they are in.

    Positions, linear velocities and shapes of the source are scaled; what the map file gives is not.
    """
    by = map_.source.length
    if by is None or by == 1:
        return episode
    placed = {name for name, entry in map_.body.items() if entry.position is not None}
    tracks = {
        name: track
        if name in placed
        else Track(
            track.position * np.float32(by),
            track.orientation,
            track.linear_velocity * np.float32(by),
            track.angular_velocity,
        )
        for name, track in episode.tracks.items()
    }
    bodies = tuple(_shapes_scaled(body, map_, by) for body in episode.header.bodies)
    header = episode.header.model_copy(update={"bodies": bodies})
    return replace(
        episode, header=header, tracks=tracks, _contacts=episode.contacts, _frames=episode.frames
    )


def _shapes_scaled(body: Body, map_: MapFile, by: float) -> Body:
    entry = map_.of_body(body.name)
    if entry is not None and "shapes" in entry.model_fields_set:
        return body
    if any(geom.mesh is not None for geom in body.geoms):
        raise InputError(
            map_.path, f"[source] length: the mesh of {body.name} cannot be scaled.",
            fix=f"[body.{body.name}] shapes in the map file, with their scale",
        )  # fmt: skip
    geoms = tuple(geom.scaled(by) for geom in body.geoms)
    return body.model_copy(update={"geoms": geoms})


def need_shapes(bodies: list[Body], where: str, *, among: str) -> None:
    """Refuse a scene in which no object has a shape.

    ``among``: where the source would have had shapes.

    Raises:
        SourceError: naming the objects, and the entries of a map file that give them shapes.
    """
    objects = [body.name for body in bodies if body.kind == "object"]
    if not objects or any(body.geoms for body in bodies if body.kind == "object"):
        return
    raise SourceError(
        where,
        f"no object has a shape ({', '.join(objects[:6])}{', …' if len(objects) > 6 else ''}): "
        f"{among}. Without shapes there is no contact, clearance or support.",
        fix=f'--map FILE with [body.{objects[0]}] shapes = [{{ kind = "box", size = [half x, '
        "half y, half z] }], and so on (docs/import/map.md)",
    )


def _fields(name: str, entry: BodyTable, map_: MapFile, meshes: Meshes) -> dict[str, Any]:
    values = {field: getattr(entry, field) for field in entry.model_fields_set}
    out: dict[str, Any] = {
        field: values[field]
        for field in (
            "kind", "movable", "mass", "com", "inertia", "finger", "material", "tags", "parent",
            "excluded",
        )
        if field in values
    }  # fmt: skip
    if "up" in values:
        out["up_axis"] = _unit(values["up"], name) if values["up"] else None
    if values.get("tcp") is not None:
        out["tcp"] = Tcp(**values["tcp"].model_dump())
    if values.get("cavity"):
        out["cavity"] = Cavity(**values["cavity"].model_dump())
    if values.get("shapes"):
        out["geoms"] = tuple(_geom(name, shape, map_, meshes) for shape in values["shapes"])
    return out


def _geom(body: str, shape: ShapeTable, map_: MapFile, meshes: Meshes) -> Geom:
    fields = shape.model_dump(exclude={"file", "scale", "friction"})
    fields["orientation"] = _unit(shape.orientation, body)
    if shape.friction is not None:
        fields["friction"] = shape.friction
    if shape.kind in ("mesh", "convex_mesh"):
        mesh = _mesh(Path(map_.path).parent, shape, f"{map_.path}: body.{body}")
        meshes[mesh.key] = mesh
        fields["mesh"] = mesh.key
    return Geom(**fields)


def _mesh(folder: Path, shape: ShapeTable, where: str) -> Mesh:
    if shape.file is None:
        raise InputError(where, f"a {shape.kind} without a file.", fix='file = "mug.obj"')
    try:
        vertices, faces = read_mesh(folder / shape.file)
    except InputError as error:
        raise InputError(where, f"{error.where} {error.what}", error.allowed) from None
    return Mesh.build(vertices * shape.scale, faces if shape.kind == "mesh" else ())


def _unit(vector: Any, body: str) -> Any:
    v = np.asarray(vector, np.float64)
    length = float(np.linalg.norm(v))
    if not length > 0:
        raise InputError(f"body.{body}", f"{tuple(vector)} has no direction.")
    return tuple(float(x) for x in v / length)
