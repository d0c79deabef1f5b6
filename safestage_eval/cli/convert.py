"""``safestage convert``."""

from __future__ import annotations

from pathlib import Path

import click

from .options import progress, traces_argument


@click.command("convert")
@traces_argument
@click.option("--to", "form", type=click.Choice(["parquet", "mcap"]), required=True)
@click.option(
    "--out", "-o", "out", type=click.Path(path_type=Path), required=True,
    help="A folder: a dataset for parquet, one file per episode for mcap.",
)  # fmt: skip
@click.option("--force", is_flag=True, help="Replace episodes that are already there.")
@click.option("--recover", is_flag=True, help="Keep the whole frames of a truncated MCAP file.")
@click.pass_context
def command(
    ctx: click.Context, traces: tuple[str, ...], form: str, out: Path, force: bool, recover: bool
) -> None:
    """Copy episodes into another format, losslessly.

    The sources are never changed. Every copy is read back, and its content hash compared.

    \b
        safestage convert traces/ --to mcap --out mcaps/
        safestage convert rollout.mcap --to parquet --out dataset/
    """
    from safestage_eval.errors import InputError
    from safestage_eval.formats import discover, save

    refs = discover(list(traces))
    there = (
        {r.episode_id for r in discover([out])} if out.exists() and any(out.iterdir()) else set()
    )
    failed = 0
    with progress("converting") as tell:
        for done, ref in enumerate(refs):
            try:
                episode = ref.open(recover=recover)
                name = episode.header.episode_id
                target = out / f"{name}.mcap" if form == "mcap" else out
                if not force and name in there:
                    raise InputError(str(out), f"{name!r} is already there.", fix="--force")
                out.mkdir(parents=True, exist_ok=True)
                copy = save(episode, target, "mcap" if form == "mcap" else "parquet")
                if copy.open().content_hash != episode.content_hash:
                    raise InputError(str(target), "the copy differs from its source.")
            except InputError as error:
                failed += 1
                click.echo(f"problem: {error}", err=True)
            else:
                click.echo(f"{name}  {episode.content_hash[:16]}  {target}")
            if tell is not None:
                tell(done + 1, len(refs))
    ctx.exit(2 if failed else 0)
