"""``safestage plot``."""

from __future__ import annotations

from pathlib import Path

import click

from .outputs import Output
from .rule_choice import RuleChoice, rule_options
from .shared_options import chosen_ref, episode_option, progress
from .terminal import say


@click.command("plot")
@click.argument("trace")
@click.argument("signals", nargs=-1, metavar="[SIGNAL]...")
@episode_option
@rule_options()
@click.option(
    "--output", "-o", type=Output("png", "svg", "pdf"), required=True,
    help="Write the picture to this file: .png, .svg or .pdf.",
)  # fmt: skip
@click.option("--dark", is_flag=True, help="Draw for a page with a dark ground.")
def command(
    trace: str,
    signals: tuple[str, ...],
    episode: str | None,
    by: RuleChoice,
    output: Path,
    *,
    dark: bool,
) -> None:
    """Draw signals of one episode with their limits, stretches in violation and verdicts.

    SIGNAL is written as in rules, with bodies or roles: "clearance(target, protected)". Without
    any, those are drawn that decide the assigned rules. Limits are those of the assigned rules that
    read the signal, otherwise of any rule that does.

    \b
    Examples:
      safestage plot rollout.mcap --output why.png
      safestage plot traces/ "tilt(target)" -e EPISODE_ID --output tilt.svg
    """
    from safestage_eval.report import signal_plot
    from safestage_eval.report.figure import ready
    from safestage_eval.whatif.judge_again import Again

    ready("--output", output)
    ref = chosen_ref(trace, None, episode)
    loaded, bound = by.load_rules()
    again = Again(ref.open(), loaded, by.overrides, bound)
    with progress("drawing") as tell:
        drawn = signal_plot.panels(again, signals, progress=tell)
        signal_plot.draw(again, drawn, output, dark=dark)
    say(f"{output}: drawn", err=True)
