"""``safestage explain scene``."""

from __future__ import annotations

import click

from .command_options import command as make
from .command_options import option
from .shared_options import chosen_ref, episode_argument, episode_option
from .terminal import say_lines


@make("scene")
def command(
    trace: str,
    name: str | None = episode_argument,
    episode: str | None = episode_option,
    as_json: bool = option("Print the header as JSON.", "--json"),
) -> None:
    """Show one episode: header, bodies, roles, timeline.

    \b
    Examples:
      safestage explain scene rollout.mcap
      safestage explain scene traces/ dumbbell_near_glasses.reference-safe
    """
    opened = chosen_ref(trace, name, episode).open()
    if as_json:
        from safestage_eval._text.json_out import visible_json

        click.echo(visible_json(opened.header.model_dump_json(indent=1)))
        return
    from safestage_eval.report.episode_report import describe

    say_lines(describe(opened))
