"""The gallery: the start of each task and the outcome of its two references."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from safestage_eval.verdicts.judging import judge
from simulate.policies.policy_names import policy_named
from simulate.record.rollout import Setting, roll_out
from simulate.record.worker_pool import Died, run_many
from simulate.render.dressing import recorded_look
from simulate.render.marks import (
    PASSED,
    ROLE_COLORS,
    VIOLATED,
    captioned,
    frame_at,
    moment,
    role_colors,
)
from simulate.render.renderer import VIEWS, Camera, EpisodeRenderer, Image, Style
from simulate.tasks.task import Task

from .feasibility import REFERENCES, builtin_rules

SIZE = (256, 192)
"""Width and height of each of a task's three pictures."""
QUALITY = 45
CAMERAS = (
    VIEWS["front"],
    replace(VIEWS["front"], azimuth=220.0),
    replace(VIEWS["front"], elevation=-50.0),
    replace(VIEWS["front"], azimuth=220.0, elevation=-50.0),
)
"""Viewpoints of a task; the first one, if nothing hides what matters."""
HIDDEN = 0.2
"""Share of its best pixels below which a body counts as hidden."""
GREY = (0.25, 0.25, 0.25)
STAGES = {"ISH": "Initial state", "ETS": "Execution", "FSH": "Final state"}


@dataclass(frozen=True)
class Strip:
    """Three pictures of a task side by side, as one WebP file."""

    task: str
    webp: bytes = b""
    problem: str = ""


def strips(
    tasks: Sequence[Task], jobs: int = 1, done: Callable[[int], None] | None = None
) -> Iterator[Strip]:
    """Roll out both references on seed 0 and draw them."""
    for task, drawn in zip(tasks, run_many(strip, tasks, jobs, done), strict=True):
        yield Strip(task.id, problem=drawn.reason) if isinstance(drawn, Died) else drawn


def strip(task: Task) -> Strip:
    """Start, end of the safe reference, and decisive moment (or end) of the unsafe one."""
    shots: list[Image] = []
    camera = CAMERAS[0]
    for policy in REFERENCES:
        episode = roll_out(Setting(task), policy_named(policy)).episode()
        worst = moment(judge(episode, builtin_rules(), assigned_only=True))
        last = len(episode) - 1
        frame = frame_at(episode, worst.time) if worst.violated and worst.time else last
        color = VIOLATED if worst.violated else PASSED
        kind = policy.partition(":")[2]
        rule = worst.words.partition(":")[0] if worst.violated else worst.words
        style = Style(role_colors(episode.header), look=recorded_look(episode.header))
        with EpisodeRenderer(episode, *SIZE, style=style) as renderer:
            if not shots:
                camera = clearest(renderer, players(task))
                shots.append(captioned(renderer.frame(0, camera), [("start", GREY)]))
            words = [(f"{kind}, {episode.t[frame]:.1f} s", GREY), (rule, color)]
            shots.append(captioned(renderer.frame(frame, camera), words, color))
    return Strip(task.id, webp(np.hstack(shots)))


def players(task: Task) -> list[str]:
    """The bodies that a picture of the task must show."""
    named = [body for role in ROLE_COLORS for body in task.roles.get(role, ())]
    return [body for body in dict.fromkeys(named) if body in task.objects]


def clearest(renderer: EpisodeRenderer, bodies: Sequence[str]) -> Camera:
    """The first camera that shows enough of every body at the start, or else the best one."""
    shown = [renderer.shown(0, camera) for camera in CAMERAS]
    most = {body: max(1, *(seen.get(body, 0) for seen in shown)) for body in bodies}
    worst = [
        min((seen.get(body, 0) / most[body] for body in bodies), default=1.0) for seen in shown
    ]
    good = [camera for camera, share in zip(CAMERAS, worst, strict=True) if share >= HIDDEN]
    return good[0] if good else CAMERAS[worst.index(max(worst))]


def webp(image: Image) -> bytes:
    """A small file of a picture."""
    from PIL import Image as Pictures

    out = io.BytesIO()
    Pictures.fromarray(image).save(out, "WEBP", quality=QUALITY, method=6)
    return out.getvalue()


def page(tasks: Sequence[Task], folder: str = "gallery") -> str:
    """The page that shows the pictures, in Markdown."""
    lines = [
        "# Gallery",
        "",
        f"The {len(tasks)} tasks on environment seed 0, written by `make gallery`: how they start, where the safe",
        "reference ends, and the moment at which the unsafe one violates. Blue is the target, yellow what depends",
        "on it, pink what is protected, green the destination.",
    ]
    for stage, title in STAGES.items():
        of_stage = [task for task in tasks if task.stage == stage]
        for family in dict.fromkeys(task.family for task in of_stage):
            lines += ["", f"## {title}: {family}"]
            for task in of_stage:
                if task.family == family:
                    lines += ["", f"### {task.id}", "", f"{task.prompts.specific}  "]
                    lines += [
                        f"{', '.join(task.rules)}",
                        "",
                        f"![{task.id}]({folder}/{task.id}.webp)",
                    ]
    return "\n".join(lines) + "\n"


def write_gallery(
    tasks: Sequence[Task],
    everything: Sequence[Task],
    docs: Path,
    jobs: int = 1,
    done: Callable[[int], None] | None = None,
) -> Iterator[Strip]:
    """Draw some tasks into ``docs/gallery/`` and list all that have a picture in ``gallery.md``."""
    folder = docs / "gallery"
    folder.mkdir(parents=True, exist_ok=True)
    for one in strips(tasks, jobs, done):
        if one.webp:
            (folder / f"{one.task}.webp").write_bytes(one.webp)
        yield one
    by_id = {task.id: task for task in everything}
    for file in folder.glob("*.webp"):
        if file.stem not in by_id:
            file.unlink()
    drawn = [task for task in everything if (folder / f"{task.id}.webp").exists()]
    (docs / "gallery.md").write_text(page(drawn), encoding="utf-8")
