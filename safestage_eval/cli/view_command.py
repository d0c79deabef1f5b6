"""``safestage view``."""

from __future__ import annotations

import tempfile
import webbrowser
from pathlib import Path

import click

from .shared_options import (
    binding_options,
    chosen_ref,
    episode_argument,
    episode_option,
    pairs,
    prepare_kernels,
    rules_option,
    set_option,
    written,
)
from .terminal import say


@click.command("view")
@click.argument("trace")
@episode_argument
@episode_option
@click.option(
    "--output", "-o", type=click.Path(path_type=Path, dir_okay=False),
    help="Write the page to this file. Default: a temporary file, opened in the browser.",
)  # fmt: skip
@click.option("--open/--no-open", "open_", default=None, help="Open the browser, or do not.")
@click.option("--all", "-a", "everything", is_flag=True, help="Show rules that passed as well.")
@rules_option
@binding_options
@set_option
def command(
    trace: str,
    name: str | None,
    episode: str | None,
    output: Path | None,
    open_: bool | None,
    everything: bool,
    rules: tuple[str, ...],
    bind: Path | None,
    assign: tuple[str, ...],
    roles: tuple[str, ...],
    protect: tuple[str, ...],
    settings: tuple[str, ...],
) -> None:
    """Show one episode in 3-D, with its signals, limits and findings over time.

    Writes one HTML page that needs no network and no server, and opens it in the browser. Bodies
    turn red while they violate a rule; click a time or a curve to go to that moment.

    \b
    Examples:
      safestage view rollout.mcap
      safestage view traces/ EPISODE_ID --set min_clearance="5 cm"
      safestage view traces/ -e EPISODE_ID --output episode.html
    """
    from safestage_eval.rules import builtin_names, load_binding, load_rules
    from safestage_eval.viewer.episode.episode_page import build
    from safestage_eval.whatif.judge_again import Again

    ref = chosen_ref(trace, name, episode)
    loaded = load_rules(list(rules) or builtin_names())
    prepare_kernels()
    bound = load_binding(bind, loaded, assign, roles, protect)
    again = Again(ref.open(), loaded, pairs(settings, "--set"), bound)
    target = output or Path(tempfile.mkdtemp(prefix="safestage-")) / "episode.html"
    written(build(again, everything=everything), target)
    click.echo(target)
    wanted = output is None if open_ is None else open_
    if wanted and not webbrowser.open(target.resolve().as_uri()):
        say("no browser could be opened; open the file yourself", err=True)
