"""Pictures of a recorded episode, drawn from what its trace holds: to look at what happened."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.closing import Closing
from safestage_eval.episode import Body, Episode, Geom
from safestage_eval.formats.atomic import write_output
from simulate.cameras.graphics import Canvas, drawing_ids, ids_of
from simulate.catalogue.objects import REGION_ALPHA, catalogue
from simulate.looks.room import Look, furnish
from simulate.world.world import FLOOR_Z, TABLE_CENTRE, TABLE_HALF

from .dressing import dress_arm, paint_body

Image = NDArray[np.uint8]
"""(H, W, 3), red green blue."""
Color = tuple[float, float, float]
"""Red, green, blue in 0 … 1."""
ROBOT_GROUP = 1
"""MuJoCo's visual group of the geoms of arm and gripper."""
FOV = 45.0
"""deg, vertical field of a perspective view."""
STILL = 5e-4
"""m that may pass unseen: a quarter of a pixel of a film, 1.15 m away and 440 pixels high."""
ARM = 0.3
"""m from the origin of a body to its surface, at most, where a turn is compared with a pixel."""

PALETTE = ((0.85, 0.45, 0.2), (0.3, 0.55, 0.8), (0.5, 0.7, 0.35), (0.75, 0.5, 0.75))
"""Colours of objects that are not in the catalogue, in turn."""
ROBOT_COLOR, GRIPPER_COLOR, FIXTURE_COLOR = (0.9, 0.9, 0.92), (0.25, 0.25, 0.28), (0.72, 0.6, 0.45)


@dataclass(frozen=True)
class Camera:
    """A look at a point from a distance; lengths in m, angles in degrees."""

    at: tuple[float, float, float] = (0.5, 0.0, 0.08)
    distance: float = 1.15
    azimuth: float = 140.0
    elevation: float = -25.0
    height: float | None = None
    """m that the picture is high, of an orthographic view; None: perspective."""


VIEWS = {
    "front": Camera(),
    "side": Camera(azimuth=90.0, elevation=-12.0),
    "top": Camera(azimuth=180.0, elevation=-80.0),
    "close": Camera(distance=0.6, azimuth=120.0),
}


@dataclass(frozen=True)
class Style:
    """Style of a drawn scene.

    Attributes:
        colors: body → red, green, blue in 0 … 1; others have the catalogue's.
        opacity: body → 0 (unseen) … 1; others are solid, regions seen through.
        sky: colour behind everything.
        shadow: texels on a side of the shadows' map; fewer are faster.
        samples: of each pixel, against steps in outlines; fewer are faster, 0 is fastest.
        matt: nothing shines, and what faces lamp and camera is not overexposed.
        look: a room, its light and paint, for a recording of SafeStage's own; None: plain shapes.
    """

    colors: Mapping[str, Color] = field(default_factory=dict)
    opacity: Mapping[str, float] = field(default_factory=dict)
    sky: Color = (0.0, 0.0, 0.0)
    shadow: int = 4096
    samples: int = 4
    matt: bool = False
    look: Look | None = None


class EpisodeRenderer(Closing):
    """Draws frames of an episode off screen. A context manager: it holds a graphics context.

    Without a look, the shapes are those of the trace, so the picture shows what is judged; with one,
    they are painted. One at a time per process.
    """

    def __init__(
        self,
        episode: Episode,
        width: int = 640,
        height: int = 480,
        *,
        style: Style | None = None,
    ) -> None:
        """Build the scene; raises InputError where nothing can be drawn off screen."""
        style = style or Style()
        self._episode = episode
        spec = mujoco.MjSpec()
        spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
        spec.visual.headlight.ambient = [0.4, 0.4, 0.4]
        spec.visual.quality.shadowsize = style.shadow
        spec.visual.quality.offsamples = style.samples
        if style.matt:
            spec.visual.headlight.ambient = [0.45, 0.45, 0.45]
            spec.visual.headlight.diffuse = [0.25, 0.25, 0.25]
            spec.visual.headlight.specular = [0.0, 0.0, 0.0]
        if any(style.sky):
            spec.add_texture(
                type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
                builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
                rgb1=style.sky,
                rgb2=style.sky,
                width=8,
                height=48,
            )
        if style.look is None:
            spec.worldbody.add_light(
                pos=[0.3, -0.7, 1.8],
                dir=[0.1, 0.4, -1],
                diffuse=[0.5, 0.5, 0.5],
                specular=[0.0, 0.0, 0.0] if style.matt else [0.3, 0.3, 0.3],
                castshadow=True,
            )
        else:
            furnish(spec, style.look, (TABLE_HALF, TABLE_CENTRE), FLOOR_Z)
        for key, mesh in episode.meshes.items():
            spec.add_mesh(
                name=key,
                uservert=mesh.vertices.astype(float).ravel(),
                userface=mesh.faces.ravel(),
                inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX,
            )
        bodies = episode.header.bodies
        # unnamed: one may be called world
        nodes = {body.name: spec.worldbody.add_body(mocap=True) for body in bodies}
        dressed = set()
        if style.look is not None:
            dressed = dress_arm(spec, nodes, episode.header, ROBOT_GROUP)
        for i, body in enumerate(bodies):
            node = nodes[body.name]
            for geom in () if body.name in dressed else body.geoms:
                color = style.colors.get(body.name) or _color(body, i)
                solid = REGION_ALPHA if body.kind == "region" else 1.0
                group = ROBOT_GROUP if body.kind in ("robot", "gripper") else 0
                _add_geom(node, geom, color, style.opacity.get(body.name, solid), group)
            if style.look is not None and body.name not in dressed:
                paint_body(
                    spec, node, body, style.colors.get(body.name), style.opacity.get(body.name, 1.0)
                )
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._canvas = Canvas(self._model, width, height)
        self._scene = self._canvas.scene

    def fade(self, opacity: Mapping[str, float]) -> None:
        """See bodies through from now on: name → 0 (unseen) … 1."""
        for name, alpha in opacity.items():
            of = self._model.geom_bodyid == self._episode.body_index[name] + 1
            self._model.geom_rgba[of, 3] = alpha

    def frame(
        self,
        index: int,
        camera: Camera = VIEWS["front"],
        *,
        shadows: bool = True,
        robot: bool = True,
        between: tuple[Sequence[str], Sequence[str]] | None = None,
        line: Color = (0.0, 0.0, 0.0),
    ) -> Image:
        """The picture of one frame; a negative index counts from the end.

        ``shadows``, ``robot``: whether they are drawn. ``between``: two groups of bodies, whose shortest
        distance is drawn in the colour of ``line``.
        """
        episode, data = self._episode, self._data
        for i, body in enumerate(episode.header.bodies):
            track = episode.tracks[body.name]
            row = index if len(track) > 1 else 0
            slot = int(self._model.body_mocapid[i + 1])  # body 0 is MuJoCo's world
            data.mocap_pos[slot] = track.position[row]
            data.mocap_quat[slot] = track.orientation[row]
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_camlight(self._model, data)
        view = mujoco.MjvCamera()
        view.lookat[:] = camera.at
        view.distance, view.azimuth = camera.distance, camera.azimuth
        view.elevation = camera.elevation
        self._model.vis.global_.fovy = FOV
        options = mujoco.MjvOption()
        options.geomgroup[ROBOT_GROUP] = robot
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        mujoco.mjv_updateScene(
            self._model,
            data,
            options,
            None,
            view,
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._scene,
        )
        if between is not None:
            self._draw_shortest(*between, line)
        if camera.height is not None:
            for eye in self._scene.camera:
                eye.orthographic = 1
                eye.frustum_top, eye.frustum_bottom = camera.height / 2, -camera.height / 2
        return self._canvas.draw()

    def _draw_shortest(self, a: Sequence[str], b: Sequence[str], color: Color) -> None:
        """Add the shortest segment between two groups of bodies to the scene, where there is one within 1 m."""
        model, scene, ends, least = self._model, self._scene, np.zeros(6), 1.0
        index = self._episode.body_index
        first, second = (
            np.flatnonzero(np.isin(model.geom_bodyid, [index[name] + 1 for name in names]))
            for names in (a, b)
        )
        for one in first:
            for other in second:
                found = np.zeros(6)
                apart = mujoco.mj_geomDistance(model, self._data, one, other, least, found)
                if apart < least:
                    least, ends = apart, found
        if least >= 1.0 or scene.ngeom >= scene.maxgeom:
            return
        rod, kind = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_CAPSULE
        mujoco.mjv_initGeom(
            rod, kind, np.zeros(3), np.zeros(3), np.zeros(9), np.array([*color, 1.0], np.float32)
        )
        mujoco.mjv_connector(rod, kind, 0.004, ends[:3], ends[3:])
        scene.ngeom += 1

    def still(self, index: int, other: int, within: float = STILL) -> bool:
        """Whether two frames look alike: no body is further than ``within`` m from where it was.

        A body's surface is taken to be at most ``ARM`` m from its origin.
        """
        for track in self._episode.tracks.values():
            if len(track) == 1 or index == other:
                continue
            moved = np.linalg.norm(track.position[index] - track.position[other])
            before, now = track.orientation[other], track.orientation[index]
            turned = 2 * min(np.linalg.norm(now - before), np.linalg.norm(now + before))
            if moved + turned * ARM > within:
                return False
        return True

    def shown(self, index: int, camera: Camera = VIEWS["front"]) -> dict[str, int]:
        """Body → pixels that it has in the picture of a frame; none for what is hidden."""
        numbers, pixels = np.unique(self.owners(index, camera), return_counts=True)
        bodies = self._episode.header.bodies
        return {
            bodies[i].name: n
            for i, n in zip(numbers.tolist(), pixels.tolist(), strict=True)
            if i >= 0
        }

    def owners(
        self, index: int, camera: Camera = VIEWS["front"], *, robot: bool = True
    ) -> NDArray[np.int64]:
        """(H, W) for each pixel of a frame's picture the index of its body in the header, or -1.

        Without ``robot`` what it hides is seen.
        """
        with drawing_ids(self._scene):
            image = self.frame(index, camera, shadows=False, robot=robot)
        ids = ids_of(image)
        owner = np.full(max(self._scene.ngeom, 1), -1, np.int64)
        for i, geom in enumerate(self._scene.geoms[: self._scene.ngeom]):
            if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                owner[i] = self._model.geom_bodyid[geom.objid] - 1  # body 0 is the world
        own = (ids >= 0) & (ids < self._scene.ngeom)  # others are blends of two at an outline
        return np.where(own, owner[np.where(own, ids, 0)], -1)

    def close(self) -> None:
        """Give the graphics context back."""
        self._canvas.close()


def write_png(image: Image, path: Path) -> None:
    """Save a picture (PNG specification, W3C 2003: 8 bits per sample, no filter)."""
    height, width, _ = image.shape
    rows = np.zeros((height, 1 + 3 * width), np.uint8)
    rows[:, 1:] = image.reshape(height, -1)

    def chunk(kind: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        )

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    write_output(
        path,
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", zlib.compress(rows.tobytes(), 6))
        + chunk(b"IEND", b""),
    )


_KINDS = {
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    "plane": mujoco.mjtGeom.mjGEOM_PLANE,
    "convex_mesh": mujoco.mjtGeom.mjGEOM_MESH,
    "mesh": mujoco.mjtGeom.mjGEOM_MESH,
}


def _add_geom(body: Any, geom: Geom, color: Color, alpha: float, group: int) -> None:
    plane = geom.kind == "plane"
    fields: dict[str, Any] = {
        "type": _KINDS[geom.kind],
        "pos": geom.position,
        "quat": geom.orientation,
        "contype": 0,
        "conaffinity": 0,
        "group": group,
        "rgba": [*((0.35, 0.37, 0.4) if plane else color), alpha],
    }
    if geom.mesh is not None:
        fields["meshname"] = geom.mesh
    else:
        fields["size"] = [3.0, 3.0, 0.1] if plane else [*geom.size, 0.0, 0.0][:3]
    body.add_geom(**fields)


def _color(body: Body, index: int) -> tuple[float, float, float]:
    if body.kind == "robot":
        return ROBOT_COLOR
    if body.kind == "gripper":
        return GRIPPER_COLOR
    model = catalogue().get(body.name)
    if model is not None:
        return model.color
    return FIXTURE_COLOR if body.kind == "fixture" else PALETTE[index % len(PALETTE)]
