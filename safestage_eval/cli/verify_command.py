"""``safestage verify``."""

from __future__ import annotations

from pathlib import Path

import click

from safestage_eval._text.plural import count

from .rule_choice import RuleChoice, rule_options
from .shared_options import prepare_kernels, progress
from .terminal import say

SHOWN = 20
"""Differences that are written out."""


@click.command("verify")
@click.argument("results", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("traces", nargs=-1, required=True, metavar="TRACES...")
@click.option(
    "--manifest", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE",
    help="Read what was judged, and how, from this manifest. Default: RESULTS.intoto.json, if there.",
)  # fmt: skip
@click.option(
    "--sample", type=click.IntRange(0), metavar="N",
    help="Judge only N episodes again, chosen by --seed. Default: all. Digests are computed of all.",
)  # fmt: skip
@click.option("--seed", type=int, default=0, show_default=True, help="Random seed for --sample.")
@rule_options(roles=True)
@click.pass_context
def command(
    ctx: click.Context,
    results: Path,
    traces: tuple[str, ...],
    manifest: Path | None,
    sample: int | None,
    seed: int,
    by: RuleChoice,
) -> None:
    """Verify that results are those of the traces: recompute digests, and judge again.

    RESULTS is a file of rows that `score` wrote. With the manifest that `score --manifest` wrote,
    rules and settings are those of the manifest; without it, those of the options. A signature on
    the manifest is for you to check first (docs/provenance.md).

    \b
    Examples:
      safestage score traces/ -f csv -o r.csv --manifest r.csv.intoto.json
      safestage verify r.csv traces/
      safestage verify rows.csv traces/ --rules fsh --sample 20 --seed 7

    Exit code 0: everything is as stated. 1: something differs. 2: something could not be verified,
    or wrong usage.
    """
    from safestage_eval.errors import InputError
    from safestage_eval.formats import discover
    from safestage_eval.provenance.manifest import ENDING, read_manifest
    from safestage_eval.provenance.verify_results import verify
    from safestage_eval.run.settings import load_settings

    beside = results.with_name(results.name + ENDING)
    if manifest is None and beside.is_file():
        manifest = beside
    statement = None if manifest is None else read_manifest(manifest)
    how = by.stated()
    if statement is not None:
        if by:
            raise click.UsageError(
                "rules and settings are those of the manifest: leave out the options"
            )
        stated = statement["predicate"]["settings"]
        names = (*how, "backend", "assigned_only")
        how |= {name: stated[name] for name in names if name in stated}
    prepare_kernels()
    try:
        asked = load_settings(**how)
    except (TypeError, AttributeError) as error:
        raise InputError(str(manifest), f"its settings cannot be read: {error}.") from None
    with progress("verifying") as tell:
        verification = verify(
            results, discover(list(traces)), asked, statement=statement, sample=sample, seed=seed,
            progress=tell,
        )  # fmt: skip
    for kind, lines in (
        ("differs", verification.differences),
        ("not verified", verification.missing),
    ):
        for line in lines[:SHOWN]:
            say(f"{kind}: {line}")
        if len(lines) > SHOWN:
            say(f"{kind}: and {len(lines) - SHOWN} more")
    for note in verification.notes:
        say(f"note: {note}", err=True)
    if statement is None:
        say("note: no manifest: rules and settings are those of the options", err=True)
    say(
        f"{count(verification.rows, 'row')} of {count(verification.episodes, 'episode')}: {verification.digests} digests "
        f"computed, {verification.judged} judged again, {count(len(verification.differences), 'difference')}, "
        f"{len(verification.missing)} not verified"
    )
    ctx.exit(verification.exit_code)
