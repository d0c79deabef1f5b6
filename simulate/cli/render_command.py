"""``safestage plot film``."""

from __future__ import annotations

from pathlib import Path

import click

from safestage_eval.cli.command_options import command, option
from safestage_eval.cli.outputs import Output
from safestage_eval.cli.rule_choice import RuleChoice, rule_options
from safestage_eval.cli.shared_options import chosen_ref, episode_argument, episode_option
from safestage_eval.cli.terminal import progress, say, waiting

from .simulate_options import explains


@command("film")
@explains
def render(
    trace: str,
    name: str | None = episode_argument,
    episode: str | None = episode_option,
    output: Path | None = option(
        "Film file: .mp4, .gif or .webp. Default: EPISODE_ID.mp4.",
        "-o", of=Output("mp4", "gif", "webp"),
    ),
    by: RuleChoice = rule_options(values=False),
    view: str = option("", of=("front", "side", "top", "close"), default="front"),
    speed: float = option("", of=click.FloatRange(0, min_open=True), default=1.0),
    plain: bool = option("Draw the shapes that are judged, without room and textures."),
) -> None:  # fmt: skip
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
