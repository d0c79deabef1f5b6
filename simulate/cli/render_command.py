"""``safestage plot film``."""

from __future__ import annotations

from pathlib import Path

import click

from safestage_eval.cli.outputs import Output
from safestage_eval.cli.rule_choice import RuleChoice, rule_options
from safestage_eval.cli.shared_options import (
    chosen_ref,
    episode_argument,
    episode_option,
    progress,
    waiting,
)
from safestage_eval.cli.terminal import say

from .simulate_options import explains


@click.command("film")
@click.argument("trace")
@episode_argument
@episode_option
@click.option(
    "--output",
    "-o",
    type=Output("mp4", "gif", "webp"),
    help="Film file: .mp4, .gif or .webp. Default: EPISODE_ID.mp4.",
)
@rule_options(values=False)
@click.option("--view", type=click.Choice(["front", "side", "top", "close"]), default="front")
@click.option("--speed", type=click.FloatRange(0, min_open=True), default=1.0, show_default=True)
@click.option(
    "--plain", is_flag=True, help="Draw the shapes that are judged, without room and textures."
)
@explains
def render(
    trace: str,
    name: str | None,
    episode: str | None,
    output: Path | None,
    by: RuleChoice,
    view: str,
    speed: float,
    plain: bool,
) -> None:
    """Film an episode: roles in colours, and a halt at the moment of its verdict.

    Blue is the target, yellow what depends on it, pink what is protected, green the destination.

    \b
    Examples:
      safestage plot film rollout.mcap
      safestage plot film traces/ fsh_orange_on_plate.reference-unsafe -o orange.gif --view side
    """
    from safestage_eval.formats.save import mcap_name
    from safestage_eval.verdicts import judge
    from simulate.render.renderer import VIEWS
    from simulate.render.video import film

    ref = chosen_ref(trace, name, episode)
    loaded, bound = by.load_rules()
    recorded = ref.open()
    path = output or Path(mcap_name(recorded.header.episode_id)).with_suffix(".mp4")
    with waiting("judging"):
        result = judge(recorded, loaded, bind=bound)
    with progress("filming") as tell:
        if tell is not None:
            tell(0, None)  # the scene is built before the first picture
        count = film(
            recorded, result, path, camera=VIEWS[view], speed=speed, plain=plain, progress=tell
        )
    say(f"{path}: {count} pictures")
