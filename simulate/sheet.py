"""Picture sheets: the moments of a rollout side by side, to be judged without seeing a verdict.

Nothing of a verdict is drawn, nor who acted. What is drawn comes from the trace alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode
from safestage_eval.errors import InputError
from safestage_eval.geometry.pose import matrix
from safestage_eval.geometry.shape import BodyShape

from .key_frames import key_frames
from .marks import ROLE_COLORS, Color, frame_at
from .render import FOV, Camera, EpisodeRenderer, Image, Style

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw
    from PIL.ImageFont import FreeTypeFont

F64 = NDArray[np.float64]

CELL = (480, 360)
"""Width, height of a cell in pixels."""
COLUMNS = 3
COUNT = 12
"""Cells on a sheet."""
COLORS: dict[str, Color] = {
    **ROLE_COLORS,
    "fragile": (0.87, 0.24, 0.20),
    "forbidden": (0.87, 0.24, 0.20),
    "bystander": (0.60, 0.35, 0.75),
    "pier": (0.55, 0.40, 0.25),
    "container": (0.25, 0.62, 0.33),
}
"""Role → colour; the first role that a body plays counts."""
OTHER_ROLE: Color = (0.60, 0.35, 0.75)
OBJECT: Color = (0.78, 0.78, 0.72)
FIXTURE: Color = (0.80, 0.72, 0.60)
LINKS, HAND = 0.22, 0.7
"""Opacity of the arm's links, and of the gripper …"""
LINKS_ABOVE, HAND_ABOVE = 0.1, 0.3
"""… and seen from above, where they stand in the way."""
SKY: Color = (0.93, 0.95, 0.97)
BAR = 0.05
"""m, length of the scale bar."""
MARGIN = 0.04
"""m around what is framed."""
SMALLEST = 0.16
"""m, the least height of a picture."""
FALLEN = 0.25
"""m below its start, from which on a body does not widen the frame."""
PREFERENCE = 0.15
"""By how much of a body's pixels a direction is preferred to the next pair."""
LATE = 5.0
"""s before the end at which the ending begins where the goal was not reached."""

DIRECTIONS = {"front": -25.0, "robot": -30.0, "side": -4.0, "top": -89.0}
"""View → elevation, deg."""


@dataclass(frozen=True)
class Scene:
    """What of an episode is shown.

    Attributes:
        episode: which.
        roles: role → bodies.
        framed: bodies that are to be in the picture: those with a role, and objects that move.
    """

    episode: Episode
    roles: Mapping[str, Sequence[str]]
    framed: tuple[str, ...]

    @classmethod
    def of(cls, episode: Episode, roles: Mapping[str, Sequence[str]]) -> Scene:
        """Find what moves. Raises TraceError when poses are broken."""
        named = {body for bodies in roles.values() for body in bodies}
        framed = tuple(
            body.name
            for body in episode.header.bodies
            if body.geoms and (body.name in named or (_free(body) and _travels(episode, body)))
        )
        return cls(episode, roles, framed)

    @property
    def colors(self) -> dict[str, Color]:
        """Body → colour: that of its role, or a pale one. Several of a role differ in shade."""
        found: dict[str, Color] = {}
        for role, bodies in self.roles.items():
            base = COLORS.get(role, OTHER_ROLE)
            for i, name in enumerate(name for name in bodies if name not in found):
                found[name] = _shaded(base, i)
        for body in self.episode.header.bodies:
            if body.kind in ("object", "fixture") and body.name not in found:
                found[body.name] = OBJECT if body.movable else FIXTURE
        return found

    def opacity(self, view: str) -> dict[str, float]:
        """Body → how solid it is in a view: the arm is seen through, the gripper a little."""
        links, hand = (LINKS_ABOVE, HAND_ABOVE) if view == "top" else (LINKS, HAND)
        kinds = {"robot": links, "gripper": hand}
        return {b.name: kinds[b.kind] for b in self.episode.header.bodies if b.kind in kinds}


def sheet(
    scene: Scene,
    asked: Mapping[str, Any],
    views: Sequence[str] = ("front", "side", "top"),
    count: int = COUNT,
    size: tuple[int, int] = CELL,
) -> list[Image]:
    """A sheet of the whole rollout from each view.

    Args:
        scene: what is shown.
        asked: what a reviewer is told, of ``safestage_eval.label.question``.
        views: of ``DIRECTIONS``.
        count: cells.
        size: width, height of a cell.

    Raises:
        InputError: nothing can be drawn off screen, or Pillow is not installed.
    """
    frames = key_frames(scene.episode, count, scene.framed)
    found = []
    with _renderer(scene, size) as renderer:
        for view in views:
            renderer.fade(scene.opacity(view))
            camera = camera_of(scene, view, frames, size, renderer)
            cells = [_cell(scene, renderer, frame, camera) for frame in frames]
            found.append(_composed(cells, _header(scene, asked, camera), scene))
    return found


def close_up(
    scene: Scene,
    start: float,
    end: float,
    count: int = 12,
    view: str = "side",
    zoom: Sequence[str] = (),
    size: tuple[int, int] = CELL,
) -> Image:
    """Moments evenly between two times (s); ``zoom``: bodies that the view follows closely.

    Raises:
        InputError: no such body or time; or as ``sheet``.
    """
    episode = scene.episode
    unknown = [name for name in zoom if name not in episode.bodies]
    if unknown:
        raise InputError("zoom", f"no body {unknown[0]!r}.", ", ".join(episode.bodies))
    if not episode.t[0] <= start <= end:
        raise InputError("time", f"{start:g} to {end:g} s is no span of the recording.")
    frames = sorted({frame_at(episode, t) for t in np.linspace(start, end, count).tolist()})
    with _renderer(scene, size) as renderer:
        renderer.fade(scene.opacity(view))
        fixed = None if zoom else camera_of(scene, view, frames, size, renderer)
        largest = max((_height(episode, name) for name in zoom), default=0.0)
        cells = []
        for frame in frames:
            camera = fixed or camera_of(
                scene, view, [frame], size, renderer, zoom, height=largest, steady=frames
            )
            cells.append(_cell(scene, renderer, frame, camera))
    what = f"from {start:g} to {end:g} s, view: {view}" + (
        f", at {', '.join(zoom)}" if zoom else ""
    )
    return _composed(cells, [(what, True)], scene)


def ending(scene: Scene, asked: Mapping[str, Any], size: tuple[int, int] = CELL) -> Image:
    """The target and what is protected: at the goal (or 5 s before the end), 1 s before the end, then.

    A row from each of three sides; raises as ``sheet``.
    """
    episode = scene.episode
    last = float(episode.t[-1])
    first = episode.header.success_time
    times = [last - LATE if first is None else first, last - 1.0, last]
    frames = [frame_at(episode, max(time, 0.0)) for time in times]
    named = [name for role in ("target", "protected") for name in scene.roles.get(role, ())]
    zoom = [name for name in named if name in episode.bodies] or list(scene.framed)
    cells = []
    with _renderer(scene, size) as renderer:
        for view in ("side", "robot", "top"):
            renderer.fade(scene.opacity(view))
            height = max((_height(episode, name) for name in zoom[:1]), default=0.0)
            camera = camera_of(
                scene, view, frames[-1:], size, renderer, zoom, height=height, steady=frames
            )
            cells += [_cell(scene, renderer, frame, camera) for frame in frames]
    return _composed(cells, _header(scene, asked, camera), scene)


def camera_of(
    scene: Scene,
    view: str,
    frames: Sequence[int],
    size: tuple[int, int],
    renderer: EpisodeRenderer,
    bodies: Sequence[str] = (),
    *,
    height: float = 0.0,
    steady: Sequence[int] | None = None,
) -> Camera:
    """An orthographic look, or for ``front`` a perspective one, at all that is framed.

    Of directions that show it equally broad the one is taken in which the robot hides least.

    Args:
        scene: what is shown.
        view: of ``DIRECTIONS``.
        frames: at which it is to be in the picture.
        size: of the picture.
        renderer: asks what is hidden.
        bodies: others than those that the scene frames.
        height: m that the picture is to have at least.
        steady: frames by which the direction is chosen, if others.
    """
    points = _corners(scene, bodies or scene.framed, frames)
    spread = points if steady is None else _corners(scene, scene.framed, steady)
    elevation = DIRECTIONS[view]
    candidates = _azimuths(scene.episode, view, spread)
    looks = [_fitted(points, azimuth, elevation, size, height, view) for azimuth in candidates]
    if len(looks) == 1:
        return looks[0]
    probe = list(steady or frames)
    probe = probe[:: max(len(probe) // 6, 1)]
    index = scene.episode.body_index
    wanted = [index[name] for name in scene.framed]
    seen = np.array([_seen(renderer, look, probe, wanted) for look in looks])
    share = seen / np.maximum(seen.max(0), 1)
    share[:, [name in scene.roles.get("target", ()) for name in scene.framed]] *= 3
    return looks[int(np.argmax(share.sum(1) - PREFERENCE * (np.arange(len(looks)) // 2)))]


def _seen(
    renderer: EpisodeRenderer, look: Camera, frames: Sequence[int], wanted: Sequence[int]
) -> NDArray[np.int64]:
    """(N,) pixels of each wanted body in the pictures of some frames."""
    owners = np.stack([renderer.owners(frame, look) for frame in frames])
    return np.array([int((owners == body).sum()) for body in wanted])


def _renderer(scene: Scene, size: tuple[int, int]) -> EpisodeRenderer:
    style = Style(scene.colors, sky=SKY, shadow=1024, matt=True)
    return EpisodeRenderer(scene.episode, *size, style=style)


def _free(body: Body) -> bool:
    return body.kind == "object" and body.movable


def _travels(episode: Episode, body: Body) -> bool:
    position = episode.tracks[body.name].position
    return bool((np.ptp(position, axis=0) > 0.005).any())


def _shaded(color: Color, i: int) -> Color:
    factor = (1.0, 0.72, 1.3, 0.55)[i % 4]
    red, green, blue = (min(1.0, part * factor + (0.1 if factor > 1 else 0.0)) for part in color)
    return red, green, blue


_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)


def _height(episode: Episode, name: str) -> float:
    """m, of a picture that shows a body and as much about it."""
    half = BodyShape.build(episode.bodies[name], episode.meshes).half
    size = float(np.linalg.norm(half[np.isfinite(half)]))
    return max(SMALLEST, 3.2 * size)


def _corners(scene: Scene, names: Iterable[str], frames: Sequence[int]) -> F64:
    """(N, 3) m, world: corners of the boxes around bodies at some frames."""
    episode, found = scene.episode, [np.zeros((0, 3))]
    for name in names:
        shape = BodyShape.build(episode.bodies[name], episode.meshes)
        if not np.isfinite(shape.half).all():
            continue
        track = episode.tracks[name].over(len(episode))
        low = float(track.position[0, 2]) - FALLEN
        kept = [frame for frame in frames if track.position[frame, 2] >= low] or [frames[0]]
        turns, places = matrix(track.orientation[kept]), track.position[kept].astype(np.float64)
        local = shape.centre + _CORNERS * shape.half
        found.append((np.einsum("tij,cj->tci", turns, local) + places[:, None]).reshape(-1, 3))
    points = np.concatenate(found)
    return points if len(points) else np.zeros((1, 3))


def _azimuths(episode: Episode, view: str, points: F64) -> list[float]:
    """deg: along the robot's reach, or across the line along which things are spread."""
    if view == "top":
        return [90.0]
    base = next((b for b in episode.header.bodies if b.kind == "robot"), None)
    root = episode.tracks[base.name].position[0, :2] if base is not None else np.zeros(2)
    away = points[:, :2].mean(0) - root
    reach = float(np.degrees(np.arctan2(away[1], away[0])))
    if view == "robot":
        return [reach]
    if view == "front":
        return [reach + turn for turn in (140.0, -140.0, 110.0, -110.0)]
    flat = points[:, :2] - points[:, :2].mean(0)
    _, axes = np.linalg.eigh(flat.T @ flat)
    along = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
    return [along + turn for turn in (90.0, -90.0, 60.0, -60.0, 120.0, -120.0)]


def _fitted(
    points: F64, azimuth: float, elevation: float, size: tuple[int, int], height: float, view: str
) -> Camera:
    """A camera in whose picture all points lie."""
    forward, right, up = axes_of(azimuth, elevation)
    across, rise = points @ right, points @ up
    middle = (
        (across.min() + across.max()) / 2 * right
        + (rise.min() + rise.max()) / 2 * up
        + ((points @ forward).min() + (points @ forward).max()) / 2 * forward
    )
    aspect = size[0] / size[1]
    need = max(
        float(np.ptp(rise)) + 2 * MARGIN,
        (float(np.ptp(across)) + 2 * MARGIN) / aspect,
        SMALLEST,
        height,
    )
    at = (float(middle[0]), float(middle[1]), float(middle[2]))
    if view != "front":
        return Camera(at, 3.0, azimuth, elevation, need)
    slope = np.tan(np.radians(FOV / 2))
    nearer = middle @ forward - points @ forward
    away = np.maximum(
        np.abs(rise - middle @ up) / slope, np.abs(across - middle @ right) / (slope * aspect)
    )
    return Camera(at, max(float((away + nearer).max()) * 1.06, 0.3), azimuth, elevation)


def axes_of(azimuth: float, elevation: float) -> tuple[F64, F64, F64]:
    """Unit vectors forward, right and up of a camera, in the world."""
    a, e = np.radians(azimuth), np.radians(elevation)
    forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([np.sin(a), -np.cos(a), 0.0])
    return forward, right, np.cross(right, forward)


def per_metre(camera: Camera, point: F64, height: int) -> float:
    """Pixels that a metre takes across the line of sight at a point (3,) of the world."""
    if camera.height is not None:
        return height / camera.height
    forward, _, _ = axes_of(camera.azimuth, camera.elevation)
    depth = camera.distance + float((point - np.array(camera.at)) @ forward)
    return float(height / 2 / np.tan(np.radians(FOV / 2)) / max(depth, 0.05))


def _cell(scene: Scene, renderer: EpisodeRenderer, frame: int, camera: Camera) -> Image:
    """The picture of a frame: outlines of what has a role, the time, and a scale bar."""
    episode = scene.episode
    image = renderer.frame(frame, camera, shadows=camera.height is None)
    image = _outlined(scene, image, renderer.owners(frame, camera, robot=False))
    picture, pen, font = _pen(image, 17)
    pen.rectangle((0, 0, 74, 22), fill=(255, 255, 255))
    pen.text((5, 2), f"{episode.t[frame]:.2f} s", fill=(0, 0, 0), font=font)
    done = episode.header.success_time
    if done is not None and episode.t[frame] >= done:
        pen.text((82, 2), "goal reached", fill=(20, 110, 40), font=font)
    name = next(iter(scene.roles.get("target", scene.framed)), None)
    if name is not None:
        track = episode.tracks[name].over(len(episode))
        place = track.position[frame].astype(np.float64)
        height, width, _ = image.shape
        length = BAR * per_metre(camera, place, height)
        x, y = width - 10, height - 10
        pen.line((x - length, y, x, y), fill=(0, 0, 0), width=4)
        pen.text((x - length / 2 - 18, y - 22), "5 cm", fill=(0, 0, 0), font=font)
    return np.asarray(picture)


def _outlined(scene: Scene, image: Image, owners: NDArray[np.int64]) -> Image:
    """Dark lines where a body that is framed ends."""
    index = scene.episode.body_index
    wanted = np.isin(owners, [index[name] for name in scene.framed])
    edge = np.zeros(owners.shape, bool)
    for axis in (0, 1):
        differs = np.diff(owners, axis=axis) != 0
        ahead = [slice(None)] * 2
        behind = [slice(None)] * 2
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        edge[tuple(ahead)] |= differs & wanted[tuple(ahead)]
        edge[tuple(behind)] |= differs & wanted[tuple(behind)]
    out = image.copy()
    out[edge] = out[edge] // 3
    return out


def _header(scene: Scene, asked: Mapping[str, Any], camera: Camera) -> list[tuple[str, bool]]:
    """Lines of words; True: bold."""
    lines = [(f"Task: {asked['instruction'] or 'not told'}", True)]
    if asked["look"]:
        lines.append((asked["look"], False))
    lines += [(text, bold) for rule in asked["rules"] for text, bold in rule_lines(rule)]
    if asked["success"] is None:
        goal = "not told whether the goal was reached"
    elif asked["success"]:
        goal = f"goal reached at {asked['success_time']:.2f} s"
    else:
        goal = "goal not reached"
    length = float(scene.episode.t[-1])
    scale = "the same scale everywhere" if camera.height else "perspective, bar: 5 cm at the target"
    lines.append((f"{goal}; {length:.1f} s recorded. {scale}", False))
    return lines


def rule_lines(rule: Mapping[str, Any]) -> list[tuple[str, bool]]:
    """A requirement in words: title, why, and its limits."""
    limits = [f"always: {text}" for text in rule["always"]]
    limits += [f"never: {text}" for text in rule["never"]]
    limits += [f"at some time: {text}" for text in rule["once"]]
    return [
        (f"Requirement: {rule['title']}", True),
        (f"{rule['why']}  Judged: {rule['judged']};  {';  '.join(limits)}", False),
    ]


def _composed(cells: Sequence[Image], lines: Sequence[tuple[str, bool]], scene: Scene) -> Image:
    """Words, the legend, and cells row after row."""
    height, width, _ = cells[0].shape
    columns = min(COLUMNS, len(cells))
    rows = -(-len(cells) // columns)
    whole = columns * (width + 2)
    room = max(whole // 9, 30)
    told = [(part, bold) for text, bold in lines for part in wrap(text, room) or [""]]
    legend = _legend(scene)
    head = 8 + 22 * (len(told) + 1)
    out = np.full((head + rows * (height + 2), whole, 3), 255, np.uint8)
    for i, cell in enumerate(cells):
        y, x = head + i // columns * (height + 2), i % columns * (width + 2)
        out[y : y + height, x : x + width] = cell
    picture, pen, font = _pen(out, 17)
    for i, (text, bold) in enumerate(told):
        pen.text((8, 4 + 22 * i), text, fill=(0, 0, 0), font=font, stroke_width=0.4 if bold else 0)
    x, y = 8.0, 4 + 22 * len(told)
    for text, color in legend:
        pen.rectangle((x, y + 2, x + 15, y + 17), fill=_bytes(color), outline=(0, 0, 0))
        pen.text((x + 21, y), text, fill=(0, 0, 0), font=font)
        x += 21 + pen.textlength(text, font=font) + 24
    return np.asarray(picture)


def _legend(scene: Scene) -> list[tuple[str, Color]]:
    colors = scene.colors
    found: list[tuple[str, Color]] = []
    for name in scene.framed:
        roles = [role for role, bodies in scene.roles.items() if name in bodies]
        told = f"{name}: {', '.join(roles)}" if roles else f"{name}: no role"
        found.append((told, colors.get(name, OTHER_ROLE)))
    return found


def _pen(image: Image, size: int) -> tuple[Any, ImageDraw, FreeTypeFont]:
    """A picture to write on. Raises InputError when Pillow is not installed."""
    try:
        from PIL import Image as Pictures
        from PIL import ImageDraw, ImageFont
    except ImportError:
        raise InputError("pictures", "no Pillow.", fix="pip install 'safestage[video]'") from None
    picture = Pictures.fromarray(image)
    return picture, ImageDraw.Draw(picture), ImageFont.load_default(size)


def _bytes(color: Color) -> tuple[int, int, int]:
    red, green, blue = (round(255 * part) for part in color)
    return red, green, blue
