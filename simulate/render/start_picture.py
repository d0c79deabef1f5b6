"""Picture of a task's scene before anything has moved."""

from __future__ import annotations

from simulate.policies.controls import Idle
from simulate.record.rollout import Setting, roll_out
from simulate.tasks.task import Task

from .dressing import recorded_look
from .marks import role_colors
from .renderer import EpisodeRenderer, Image, Style


def start_picture(task: Task, seed: int = 0, size: tuple[int, int] = (640, 480)) -> Image:
    """The first frame, with roles in colours; ``size``: width, height in pixels."""
    episode = roll_out(Setting(task, seed, horizon=0.05), Idle()).episode()
    style = Style(role_colors(episode.header), look=recorded_look(episode.header))
    with EpisodeRenderer(episode, *size, style=style) as renderer:
        return renderer.frame(0)
