"""``safestage convert pack``."""

from __future__ import annotations

from pathlib import Path

import click

from .outputs import Output
from .shared_options import pairs, progress, traces_argument, written
from .terminal import say

FIELDS = ("policy", "task", "stage", "family", "prompt", "seed")


@click.command("pack")
@traces_argument
@click.option(
    "--out", "-o", type=Output(file=False, folder=True), required=True,
    help="Write the packed dataset to this folder; an existing one is continued.",
)  # fmt: skip
@click.option(
    "--by", default="policy,task", show_default=True, metavar="FIELDS",
    help=f"Group episodes into files by these header fields: {', '.join(FIELDS)}.",
)  # fmt: skip
@click.option(
    "--shard-episodes", type=click.IntRange(min=1), metavar="N", default=100, show_default=True,
    help="Put at most N episodes into a file.",
)  # fmt: skip
@click.option("--title", help="Title the dataset page. Default: the folder name.")
@click.option("--licence", "--license", help="State the licence of the data: cc-by-4.0, cc0-1.0, …")
@click.option(
    "--where", multiple=True, metavar="FIELD=VALUE",
    help="Select episodes by header field: policy=…, task=…, prompt=…. Repeatable.",
)  # fmt: skip
@click.pass_context
def command(
    ctx: click.Context, traces: tuple[str, ...], out: Path, by: str, shard_episodes: int,
    title: str | None, licence: str | None, where: tuple[str, ...],
) -> None:  # fmt: skip
    """Merge episodes into few large files, ready to be published.

    The sources are never changed. Every copy is read back and its content compared by hash. A run
    that was stopped continues when the same command is given again. A README.md for
    the Hugging Face hub, with a config for each table, is written beside the tables.

    \b
    Examples:
      safestage convert pack recordings/ --out published/ --licence cc-by-4.0
      safestage convert pack runs/ --out published/ --where policy=mine --by task
    """
    from safestage_eval.errors import readable
    from safestage_eval.formats import discover
    from safestage_eval.formats.dataset_card import dataset_card
    from safestage_eval.formats.packing import pack

    fields = [name.strip() for name in by.split(",") if name.strip()]
    for name in fields:
        if name not in FIELDS:
            raise click.UsageError(f"--by {name}: one of {', '.join(FIELDS)}")
    wanted = pairs(where, "--where", FIELDS)
    refs = [
        ref
        for ref in discover(list(traces))
        if ref.problem or all(str(ref.fields.get(k)) == v for k, v in wanted.items())
    ]
    with progress("packing") as tell:
        result = pack(refs, out, by=fields, shard_episodes=shard_episodes, progress=tell)
    for name, problem in result.problems:
        say(f"problem: {name}: {problem}", err=True)
    if result.packed or result.there:
        card = dataset_card(
            out, discover(out), title=title or readable(out.resolve().name), licence=licence
        )
        written(card, out / "README.md")
    shards = len(set(result.packed.values()))
    say(
        f"{len(result.packed)} episodes packed into {shards} shards of {out}"
        + (f"; {len(result.there)} were there already" if result.there else "")
        + (f"; {len(result.problems)} left out" if result.problems else "")
    )
    ctx.exit(2 if result.problems else 0)
