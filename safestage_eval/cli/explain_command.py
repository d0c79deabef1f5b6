"""``safestage explain``."""

from __future__ import annotations

from .command_options import command as make
from .command_options import option
from .rule_choice import RuleChoice, rule_options
from .shared_options import chosen_ref, episode_argument, episode_option
from .terminal import say_lines, waiting


@make("explain")
def command(
    trace: str,
    name: str | None = episode_argument,
    episode: str | None = episode_option,
    by: RuleChoice = rule_options(roles=True),
    everything: bool = option(
        "Show all rules, with bindings, stretches and every unknown value.", "--all", "-a"
    ),
) -> None:
    """Say why an episode got its verdicts: violations, and the rules assigned to it.

    \b
    Examples:
      safestage explain rollout.mcap
      safestage explain traces/ fsh_orange_on_plate.reference-safe --rules fsh
    """
    from safestage_eval.report.episode_report import explain
    from safestage_eval.verdicts import judge

    ref = chosen_ref(trace, name, episode)
    loaded, bound = by.load_rules()
    with waiting("judging"):
        result = judge(ref.open(), loaded, overrides=by.overrides, bind=bound)
    say_lines(explain(result, everything=everything))
