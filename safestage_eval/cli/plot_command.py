"""``safestage plot``."""

from __future__ import annotations

from pathlib import Path

from .command_options import argument, option
from .command_options import command as make
from .outputs import Output
from .rule_choice import RuleChoice, rule_options
from .shared_options import chosen_ref, episode_option
from .terminal import progress, say


@make("plot")
def command(
    trace: str,
    signals: tuple[str, ...] = argument("[SIGNAL]..."),
    episode: str | None = episode_option,
    by: RuleChoice = rule_options(),
    output: Path = option(
        "Write the picture to this file: .png, .svg or .pdf.",
        "-o", of=Output("png", "svg", "pdf"), required=True,
    ),
    dark: bool = option("Draw for a page with a dark ground."),
) -> None:  # fmt: skip
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
