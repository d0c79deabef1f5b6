"""``safestage validate``."""

from __future__ import annotations

import click

from .options import traces_argument


@click.command("validate")
@traces_argument
@click.pass_context
def command(ctx: click.Context, traces: tuple[str, ...]) -> None:
    """Check trace files, and list everything that is wrong with them.

    Reads every column: format, units that can be checked, unit quaternions, increasing time,
    contacts that name bodies, stored hashes. Exit code 2 if anything is wrong.
    """
    from safestage_eval.formats import discover, validate_episode

    refs = discover(list(traces))
    wrong = 0
    for ref in refs:
        found = validate_episode(ref)
        wrong += bool(found)
        for error in found:
            click.echo(f"error: {error}", err=True)
        if not found:
            click.echo(f"ok: {ref.episode_id}  ({ref.format}, {ref.path})")
    click.echo(f"{len(refs) - wrong} of {len(refs)} episodes are sound", err=True)
    ctx.exit(2 if wrong else 0)
