"""``safestage validate``."""

from __future__ import annotations

from typing import Any

import click

from .options import progress, traces_argument


@click.command("validate")
@traces_argument
@click.pass_context
def command(ctx: click.Context, traces: tuple[str, ...]) -> None:
    """Check trace files, and list everything that is wrong with them.

    Reads every column: format, units that can be checked, unit quaternions, increasing time,
    contacts that name bodies, stored hashes. Exit code 2 if anything is wrong.

    \b
    Example:
      safestage validate traces/ rollout.mcap
    """
    from safestage_eval.formats import discover, validate_episode

    refs = discover(list(traces))
    broken = 0
    first: dict[str, Any] = {}
    with progress("checking") as tell:
        for done, ref in enumerate(refs, 1):
            found = [str(error) for error in validate_episode(ref)]
            same = first.setdefault(ref.episode_id or ref.shown, ref)
            if same is not ref and same.content_hash != ref.content_hash:
                found.append(f"{ref.shown}: another episode has this id as well: {same.shown}")
            broken += bool(found)
            for problem in found:
                click.echo(f"error: {problem}", err=True)
            if not found:
                click.echo(
                    f"{ref.content_hash or '(no hash stored)'}  {ref.episode_id}  {ref.shown}"
                )
            if tell is not None:
                tell(done, len(refs))
    click.echo(f"{len(refs) - broken} of {len(refs)} episodes are sound", err=True)
    ctx.exit(2 if broken else 0)
