"""``safestage explain``."""

from __future__ import annotations

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
    waiting,
)
from .terminal import say_lines


@click.command("explain")
@click.argument("trace")
@episode_argument
@episode_option
@rules_option
@binding_options
@set_option
@click.option(
    "--all",
    "-a",
    "everything",
    is_flag=True,
    help="Also show rules that do not apply, and every unknown value.",
)
def command(
    trace: str,
    name: str | None,
    episode: str | None,
    rules: tuple[str, ...],
    bind: Path | None,
    assign: tuple[str, ...],
    roles: tuple[str, ...],
    protect: tuple[str, ...],
    settings: tuple[str, ...],
    everything: bool,
) -> None:
    """Say why an episode got its verdicts, one sentence per finding.

    \b
    Examples:
      safestage explain rollout.mcap
      safestage explain traces/ fsh_orange_on_plate.reference-safe --rules fsh
    """
    from safestage_eval.report.episode_report import explain
    from safestage_eval.rules import builtin_names, load_binding, load_rules
    from safestage_eval.verdicts import judge

    ref = chosen_ref(trace, name, episode)
    loaded = load_rules(list(rules) or builtin_names())
    prepare_kernels()
    with waiting("judging"):
        result = judge(
            ref.open(),
            loaded,
            overrides=pairs(settings, "--set"),
            bind=load_binding(bind, loaded, assign, roles, protect),
        )
    say_lines(explain(result, everything=everything))
