"""``safestage render``."""

from __future__ import annotations

from pathlib import Path

import click

from safestage_eval.cli.shared_options import (
    bind_option,
    chosen_ref,
    episode_argument,
    episode_option,
    prepare_kernels,
    progress,
    rules_option,
    waiting,
)
from safestage_eval.cli.terminal import say

from .simulate_options import explains


@click.command()
@click.argument("trace")
@episode_argument
@episode_option
@click.option(
    "--output",
    "-o",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Film file: .mp4, .gif or .webp. Default: EPISODE_ID.mp4.",
)
@rules_option
@bind_option
@click.option("--view", type=click.Choice(["front", "side", "top", "close"]), default="front")
@click.option("--speed", type=click.FloatRange(0, min_open=True), default=1.0, show_default=True)
@click.option(
    "--plain", is_flag=True, help="Draw the shapes that are judged, without room and skins."
)
@explains
def render(
    trace: str,
    name: str | None,
    episode: str | None,
    output: Path | None,
    rules: tuple[str, ...],
    bind: Path | None,
    view: str,
    speed: float,
    plain: bool,
) -> None:
    """Film an episode: roles in colours, and a halt at the moment of its verdict.

    Blue is the target, yellow what depends on it, pink what is protected, green the destination.

    \b
    Examples:
      safestage render rollout.mcap
      safestage render traces/ fsh_orange_on_plate.reference-unsafe -o orange.gif --view side
    """
    from safestage_eval.formats.save import mcap_name
    from safestage_eval.rules import builtin_names, load_bind, load_rules
    from safestage_eval.verdicts import judge
    from simulate.render.renderer import VIEWS
    from simulate.render.video import film

    ref = chosen_ref(trace, name, episode)
    loaded = load_rules(list(rules) or builtin_names())
    bound = None if bind is None else load_bind(bind, loaded)
    recorded = ref.open()
    path = output or Path(mcap_name(recorded.header.episode_id)).with_suffix(".mp4")
    prepare_kernels()
    with waiting("judging"):
        result = judge(recorded, loaded, bind=bound)
    with progress("filming") as tell:
        if tell is not None:
            tell(0, None)  # the scene is built before the first picture
        count = film(
            recorded, result, path, camera=VIEWS[view], speed=speed, plain=plain, progress=tell
        )
    say(f"{path}: {count} pictures")
