"""``safestage convert pack``."""

from __future__ import annotations

from pathlib import Path

import click

from .command_options import command as make
from .command_options import option
from .outputs import Output, written
from .shared_options import pairs, traces_argument, where_option
from .terminal import progress, say

FIELDS = ("policy", "task", "stage", "family", "prompt", "seed")


@make("pack")
def command(
    traces: tuple[str, ...] = traces_argument,
    out: Path = option(
        "Write the packed dataset to this folder; an existing one is continued.",
        "-o", of=Output(file=False, folder=True), required=True,
    ),
    by: str = option(
        f"Group episodes into files by these header fields: {', '.join(FIELDS)}.",
        default="policy,task", metavar="FIELDS",
    ),
    shard_episodes: int = option(
        "Put at most N episodes into a file.", least=1, metavar="N", default=100
    ),
    title: str | None = option("Title the dataset page. Default: the folder name."),
    licence: str | None = option(
        "State the licence of the data: cc-by-4.0, cc0-1.0, …", "--licence", "--license"
    ),
    where: tuple[str, ...] = where_option,
) -> int:  # fmt: skip
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
        heading = title or readable(out.resolve().name)
        written(dataset_card(out, discover(out), title=heading, licence=licence), out / "README.md")
    shards = len(set(result.packed.values()))
    say(
        f"{len(result.packed)} episodes packed into {shards} shards of {out}"
        + (f"; {len(result.there)} were there already" if result.there else "")
        + (f"; {len(result.problems)} left out" if result.problems else "")
    )
    return 2 if result.problems else 0
