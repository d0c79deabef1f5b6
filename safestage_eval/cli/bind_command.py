"""``safestage bind``."""

from __future__ import annotations

from pathlib import Path

import click

from safestage_eval._text.plural import count

from .shared_options import (
    output_option,
    prepare_kernels,
    selected,
    traces_argument,
    where_option,
    written,
)
from .terminal import say


@click.command("bind")
@traces_argument
@click.option("--init", is_flag=True, required=True, help="Write a bind file of guesses.")
@output_option
@where_option
def command(
    traces: tuple[str, ...],
    init: bool,  # noqa: ARG001 — required, for there is nothing else to do
    output: Path | None,
    where: tuple[str, ...],
) -> None:
    """Guess what headers leave open: roles, up axes, fingers, materials and tags.

    Writes a bind file in TOML. Each guess has its reason and how sure it is; correct them, then score
    with --bind FILE.

    \b
    Examples:
      safestage bind --init traces/ --output mine.toml
      safestage score traces/ --bind mine.toml
    """
    from safestage_eval.importers.bind_init import bind_init

    refs = selected(traces, where)
    prepare_kernels()
    written(bind_init(refs, " ".join(traces)), output)
    if output is not None:
        say(f"{output}: guesses for {count(len(refs), 'episode')}", err=True)
