"""``safestage explain scene``."""

from __future__ import annotations

import click

from .shared_options import chosen_ref, episode_argument, episode_option
from .terminal import say_lines


@click.command("scene")
@click.argument("trace")
@episode_argument
@episode_option
@click.option("--json", "as_json", is_flag=True, help="Print the header as JSON.")
def command(trace: str, name: str | None, episode: str | None, as_json: bool) -> None:
    """Show one episode: header, bodies, roles, timeline.

    \b
    Examples:
      safestage explain scene rollout.mcap
      safestage explain scene traces/ dumbbell_near_glasses.reference-safe
    """
    ref = chosen_ref(trace, name, episode)
    opened = ref.open()
    if as_json:
        from safestage_eval._text.json_out import visible_json

        click.echo(visible_json(opened.header.model_dump_json(indent=1)))
        return
    from safestage_eval.report.episode_report import describe

    say_lines(describe(opened))
