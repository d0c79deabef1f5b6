"""``safestage explain``."""

from __future__ import annotations

import click

from .options import announce_compiling, chosen_ref, episode_option, pairs, rules_option, set_option


@click.command("explain")
@click.argument("trace")
@episode_option
@rules_option
@set_option
@click.option("--all", "-a", "everything", is_flag=True, help="Rules that do not apply as well.")
def command(
    trace: str,
    episode: str | None,
    rules: tuple[str, ...],
    settings: tuple[str, ...],
    everything: bool,
) -> None:
    """Say why an episode got its verdicts, one sentence per finding.

    \b
    Examples:
      safestage explain rollout.mcap
      safestage explain traces/ --episode orange --rules fsh
    """
    from safestage_eval.report.as_text import explain
    from safestage_eval.rules import builtin_names, load_rules
    from safestage_eval.verdicts import judge

    ref = chosen_ref(trace, episode)
    loaded = load_rules(list(rules) or builtin_names())
    announce_compiling()
    result = judge(
        ref.open(), loaded, overrides=pairs(settings, "--set"), trace_hash=ref.content_hash
    )
    click.echo(explain(result, everything=everything), nl=False)
