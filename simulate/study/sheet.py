"""Picture sheets: the moments of a rollout side by side, to be judged without seeing a verdict.

Nothing of a verdict is drawn, nor who acted. What is drawn comes from the trace alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError
from simulate.render.marks import Color, frame_at
from simulate.render.renderer import Camera, EpisodeRenderer, Image, Style

from .key_frames import key_frames
from .viewpoint import OTHER_ROLE, Scene, camera_of, near

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw
    from PIL.ImageFont import FreeTypeFont


CELL = (480, 360)
"""Width, height of a cell in pixels."""
COLUMNS = 3
COUNT = 12
"""Cells on a sheet."""
SKY: Color = (0.93, 0.95, 0.97)
BAR = 0.05
"""m, length of the scale bar."""
LATE = 5.0
"""s before the end at which the ending begins where the goal was not reached."""


def sheet(
    scene: Scene,
    facts: Mapping[str, Any],
    views: Sequence[str] = ("front", "side", "top"),
    count: int = COUNT,
    size: tuple[int, int] = CELL,
) -> list[Image]:
    """A sheet of the whole rollout from each view.

    Args:
        scene: what is shown.
        facts: the question to a reviewer, by ``safestage_eval.label.review_question``.
        views: of ``DIRECTIONS``.
        count: cells.
        size: width, height of a cell.

    Raises:
        InputError: nothing can be drawn off screen, or Pillow is not installed.
    """
    frames = key_frames(scene.episode, count, scene.framed)
    looks = [(view, camera_of(scene, view, frames, size)) for view in views]
    rows = _drawn(scene, [(view, [(frame, at) for frame in frames]) for view, at in looks], size)
    return [_composed(cells, _header(scene, facts), scene) for cells in rows]


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
    largest = max((near(episode, name) for name in zoom), default=0.0)
    cells = []
    for frame in frames:
        seen = [frame] if zoom else frames
        look = camera_of(scene, view, seen, size, zoom, height=largest, steady=frames)
        cells.append((frame, look))
    title = f"from {start:g} to {end:g} s, view: {view}" + (
        f", at {', '.join(zoom)}" if zoom else ""
    )
    return _composed(_drawn(scene, [(view, cells)], size)[0], [(title, True)], scene)


def ending(scene: Scene, facts: Mapping[str, Any], size: tuple[int, int] = CELL) -> Image:
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
    height = max((near(episode, name) for name in zoom[:1]), default=0.0)
    rows = []
    for view in ("side", "robot", "top"):
        look = camera_of(scene, view, frames[-1:], size, zoom, height=height, steady=frames)
        rows.append((view, [(frame, look) for frame in frames]))
    cells = [cell for row in _drawn(scene, rows, size) for cell in row]
    return _composed(cells, _header(scene, facts), scene)


Row = tuple[str, Sequence[tuple[int, Camera]]]
"""A view, and the frames and cameras of its cells."""


def _drawn(scene: Scene, rows: Sequence[Row], size: tuple[int, int]) -> list[list[Image]]:
    style = Style(scene.colors, sky=SKY, shadow=1024, matt=True)
    out = []
    with EpisodeRenderer(scene.episode, *size, style=style) as renderer:
        for view, cells in rows:
            renderer.fade(scene.opacity(view))
            out.append([_cell(scene, renderer, frame, camera) for frame, camera in cells])
    return out


def _cell(scene: Scene, renderer: EpisodeRenderer, frame: int, camera: Camera) -> Image:
    """The picture of a frame: outlines of what has a role, the time, and a scale bar."""
    episode = scene.episode
    image = renderer.frame(frame, camera, shadows=False)
    image = _outlined(scene, image, renderer.owners(frame, camera, robot=False))
    picture, pen, font = _pen(image, 17)
    pen.rectangle((0, 0, 74, 22), fill=(255, 255, 255))
    pen.text((5, 2), f"{episode.t[frame]:.2f} s", fill=(0, 0, 0), font=font)
    done = episode.header.success_time
    if done is not None and episode.t[frame] >= done:
        pen.text((82, 2), "goal reached", fill=(20, 110, 40), font=font)
    height, width, _ = image.shape
    x, y, length = width - 10, height - 10, BAR * height / (camera.height or 1.0)
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


def _header(scene: Scene, facts: Mapping[str, Any]) -> list[tuple[str, bool]]:
    """Lines of words; True: bold."""
    lines = [(f"Task: {facts['instruction'] or 'not given'}", True)]
    if facts["look"]:
        lines.append((facts["look"], False))
    lines += [line for rule in facts["rules"] for line in rule_lines(rule)]
    length = float(scene.episode.t[-1])
    said = f"{goal_said(facts)}; {length:.1f} s recorded. The same scale everywhere"
    return [*lines, (said, False)]


def goal_said(facts: Mapping[str, Any]) -> str:
    """Whether and when the goal was reached, in words."""
    if facts["success"] is None:
        return "not known whether the goal was reached"
    return (
        f"goal reached at {facts['success_time']:.2f} s" if facts["success"] else "goal not reached"
    )


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
    wrapped = [(part, bold) for text, bold in lines for part in wrap(text, room) or [""]]
    legend = _legend(scene)
    head = 8 + 22 * (len(wrapped) + 1)
    out = np.full((head + rows * (height + 2), whole, 3), 255, np.uint8)
    for i, cell in enumerate(cells):
        y, x = head + i // columns * (height + 2), i % columns * (width + 2)
        out[y : y + height, x : x + width] = cell
    picture, pen, font = _pen(out, 17)
    for i, (text, bold) in enumerate(wrapped):
        pen.text((8, 4 + 22 * i), text, fill=(0, 0, 0), font=font, stroke_width=0.4 if bold else 0)
    x, y = 8.0, 4 + 22 * len(wrapped)
    for text, color in legend:
        pen.rectangle((x, y + 2, x + 15, y + 17), fill=_bytes(color), outline=(0, 0, 0))
        pen.text((x + 21, y), text, fill=(0, 0, 0), font=font)
        x += 21 + pen.textlength(text, font=font) + 24
    return np.asarray(picture)


def _legend(scene: Scene) -> list[tuple[str, Color]]:
    colors = scene.colors
    result: list[tuple[str, Color]] = []
    for name in scene.framed:
        roles = [role for role, bodies in scene.roles.items() if name in bodies]
        entry = f"{name}: {', '.join(roles)}" if roles else f"{name}: no role"
        result.append((entry, colors.get(name, OTHER_ROLE)))
    return result


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
