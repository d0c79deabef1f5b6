"""``safestage learn export|train``."""

from __future__ import annotations

from pathlib import Path

import click

from safestage_eval.cli.terminal import say

from .simulate_options import BadInput, explains, progress


@click.group()
def learn() -> None:
    """Train policies of your own from recordings: export them, then train."""


@learn.command()
@click.argument("traces", nargs=-1, required=True)
@click.option(
    "--out", "-o", required=True, type=click.Path(path_type=Path, file_okay=False),
    help="New folder for the dataset.",
)  # fmt: skip
@click.option(
    "--failures", is_flag=True, help="Keep episodes that did not reach their goal as well."
)
@explains
def export(traces: tuple[str, ...], out: Path, failures: bool) -> None:
    """Write recorded rollouts as a LeRobot dataset (v3): what was seen, commanded and asked, at 15 Hz.

    TRACES are files or folders that `safestage record` wrote. Episodes end at their success. Each is
    judged by its task's own rules, so that safe and unsafe ways can be told apart:
    `safestage.violation` in meta/episodes. There are no pictures; `observation.environment_state` has a
    slot for each object's pose.

    \b
    Examples:
      safestage record --policy demonstration:safe --policy demonstration:unsafe --seeds 0-9 --out demos
      safestage learn export demos --out dataset
    """
    from safestage_eval.errors import InputError
    from safestage_eval.formats import discover
    from safestage_eval.rules import load_rules
    from safestage_eval.verdicts import judge
    from simulate.learn.lerobot_writer import LeRobotWriter

    rules = load_rules(["ish", "ets", "fsh", "goals"])
    writer, refs = LeRobotWriter(out), discover(list(traces))
    steps = failed = left_out = 0
    with progress(len(refs), "episode") as show:
        for done, ref in enumerate(refs, 1):
            try:
                episode = ref.open()
                if not (episode.header.success or failures):
                    left_out += 1
                else:
                    found = judge(episode, rules, assigned_only=True)
                    steps += writer.add(episode, found.violation)
            except InputError as error:
                failed += 1
                say(f"problem: {error}", err=True)
            show(done)
    writer.close()
    kept = len(refs) - failed - left_out
    say(f"{kept} episodes, {steps:,} control steps in {out}" + (
        f"; {left_out} left out that did not reach their goal" if left_out else ""
    ))  # fmt: skip
    if failed:
        raise BadInput(f"{failed} of {len(refs)} episodes could not be exported")
