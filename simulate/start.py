"""How a task's scene looks before anything has moved."""

from __future__ import annotations

from .controls import Idle
from .marks import role_colors
from .render import EpisodeRenderer, Image, Style
from .rollout import Setting, roll_out
from .task import Task


def start_picture(task: Task, seed: int = 0, size: tuple[int, int] = (640, 480)) -> Image:
    """The first frame, with roles in colours; ``size``: width, height in pixels."""
    episode = roll_out(Setting(task, seed, horizon=0.05), Idle()).episode()
    with EpisodeRenderer(episode, *size, style=Style(role_colors(episode.header))) as renderer:
        return renderer.frame(0)
