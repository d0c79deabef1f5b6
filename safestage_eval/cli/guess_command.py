"""``safestage import guess``."""

from __future__ import annotations

from pathlib import Path

from safestage_eval._text.plural import count

from .command_options import command as make
from .command_options import option
from .outputs import Output, written
from .shared_options import selected, traces_argument, where_option
from .terminal import say


@make("guess")
def command(
    traces: tuple[str, ...] = traces_argument,
    output: Path | None = option("Write to this file instead of stdout.", "-o", of=Output("toml")),
    where: tuple[str, ...] = where_option,
) -> None:
    """Guess what headers leave open: roles, up axes, fingers, materials and tags.

    Writes a bind file in TOML. Each guess has its reason and how sure it is; correct them, then score
    with --bind FILE.

    \b
    Examples:
      safestage import guess traces/ --output mine.toml
      safestage score traces/ --bind mine.toml
    """
    from safestage_eval.importers.bind_init import bind_init

    refs = selected(traces, where)
    written(bind_init(refs, " ".join(traces)), output)
    if output is not None:
        say(f"{output}: guesses for {count(len(refs), 'episode')}", err=True)
