"""``safestage bench tasks gallery``."""

from __future__ import annotations

from pathlib import Path

import click

from safestage_eval.cli.outputs import Output
from safestage_eval.cli.terminal import say

from .simulate_options import BadInput, chosen_tasks, explains, jobs_option, progress


@click.command()
@click.argument("tasks", nargs=-1, metavar="[TASK]...")
@click.option(
    "--out",
    type=Output(file=False, folder=True),
    default=Path("docs"),
    show_default=True,
    help="Folder for gallery.md and gallery/.",
)
@jobs_option
@explains
def gallery(tasks: tuple[str, ...], out: Path, jobs: int) -> None:
    """Draw tasks: the initial scene, and the end of both references."""
    from simulate.feasibility.gallery import write_gallery

    chosen, everything = chosen_tasks(tasks), chosen_tasks(())
    failed = 0
    with progress(len(chosen), "task") as show:
        for strip in write_gallery(chosen, everything, out, jobs, show):
            failed += bool(strip.problem)
            say(f"{strip.task}: {strip.problem or f'{len(strip.webp) / 1000:.1f} kB'}")
    if failed:
        raise BadInput(f"{failed} tasks could not be drawn")
