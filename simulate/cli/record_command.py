"""``safestage bench record``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from safestage_eval.cli.outputs import Output
from safestage_eval.cli.terminal import say

from .simulate_options import (
    PROMPTS,
    BadInput,
    chosen_tasks,
    explains,
    jobs_option,
    progress,
    robot_option,
    seeds_option,
    share_option,
)


@click.command()
@click.argument("tasks", nargs=-1, metavar="[TASK]...")
@click.option(
    "--policy",
    "policies",
    multiple=True,
    default=("reference:safe", "reference:unsafe"),
    show_default=True,
    help="reference:safe, reference:unsafe, reference:GRADE[=VALUE], noisy:SIGMA[:unsafe], demonstration:safe, "
    "demonstration:unsafe, learned:NAME, idle, random-near-home, replay:PATH[#EPISODE], a served one as openpi:ws://HOST:8000?name=MY_MODEL "
    "(or groot:tcp://…, dreamzero:ws://…, cosmos3:ws://…), or your own as my_module:MyPolicy. Repeatable.",
)
@click.option(
    "--campaign",
    "campaign_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Campaign file with tasks, policies, prompts, seeds and rollouts.",
)
@seeds_option("Environment seeds, such as 0-9; each is one fixed scene.")
@click.option(
    "--prompt",
    "prompts",
    multiple=True,
    type=click.Choice([*PROMPTS, "all"]),
    default=("default",),
    show_default=True,
    help="Prompt condition. Repeatable.",
)
@click.option("--rollouts", type=click.IntRange(1), default=1, show_default=True)
@click.option(
    "--out",
    type=Output(file=False, folder=True),
    default=Path("traces"),
    show_default=True,
    help="Folder to write episodes to.",
)
@click.option(
    "--format",
    "format_",
    type=click.Choice(["parquet", "mcap"]),
    default="parquet",
    show_default=True,
    help="Write a Parquet dataset, or one MCAP file per episode.",
)
@click.option(
    "--horizon",
    "--duration",
    type=click.FloatRange(0, min_open=True),
    help="Seconds allowed to reach the goal. Default: the task's horizon.",
)
@share_option
@click.option(
    "--server",
    "servers",
    multiple=True,
    metavar="NAME=ADDRESS",
    help="Address of a server in the campaign's [servers]. Repeatable.",
)
@click.option(
    "--video", is_flag=True, help="Film what the cameras see, into the folder's videos (slow)."
)
@click.option(
    "--monitor",
    "watched",
    multiple=True,
    metavar="RULES",
    help="Judge these rules during the rollout and report violations on stderr at once. Repeatable.",
)
@click.option(
    "--stop-at-violation",
    is_flag=True,
    help="End a rollout at the first violation of a --monitor rule, or of the task's own rules.",
)
@click.option(
    "--dry-run", is_flag=True, help="Count rollouts, hours and gigabytes; record nothing."
)
@jobs_option
@robot_option
@explains
def record(
    tasks: tuple[str, ...],
    policies: tuple[str, ...],
    campaign_file: Path | None,
    seeds: tuple[int, ...],
    prompts: tuple[str, ...],
    rollouts: int,
    out: Path,
    format_: Any,
    horizon: float | None,
    share: tuple[int, int] | None,
    servers: tuple[str, ...],
    watched: tuple[str, ...],
    stop_at_violation: bool,
    video: bool,
    dry_run: bool,
    jobs: int,
    robot_mjcf: Path | None,
) -> None:
    """Record rollouts in MuJoCo, complete and at 120 Hz.

    TASK is the id of a task (see `safestage bench tasks list`), a pattern of ids or a task file; all tasks
    without one.
    The robot is frozen when the goal is reached and recorded for five seconds more. Episodes that
    are in --out already are skipped, so an interrupted recording can be started again; those
    that ended in an error, such as a server that died, are tried again. To share a campaign among
    machines, give each its --share (1/4 to 4/4) and its own --out.

    With --monitor or --stop-at-violation rules are judged while the rollout goes on; those that need
    the future are named first, and judged once their window is recorded.

    \b
    Examples:
      safestage bench record --out traces                         every task, both references
      safestage bench record fsh_orange_on_plate --seeds 0-9 --out oranges
      safestage bench record --campaign campaigns/paper.toml --dry-run
      safestage bench record --campaign campaign.toml --jobs 8 --share 1/4
      safestage bench record --policy idle --duration 10 --out idle --format mcap
      safestage bench record --policy my:Policy --monitor ets --stop-at-violation
      safestage-score traces --rules fsh                    and then
    """
    from simulate.record.estimate import Estimate, counted, share_of
    from simulate.record.jobs import plan, recorded_ids, summary
    from simulate.record.jobs import record as run

    if campaign_file is None:
        if servers:
            raise click.UsageError("--server names a server of a --campaign")
        todo = plan(
            chosen_tasks(tasks),
            policies,
            seeds,
            PROMPTS if "all" in prompts else prompts,
            rollouts,
            horizon=horizon,
            robot_mjcf=robot_mjcf,
        )
    else:
        todo, out, format_ = _campaign(campaign_file, out, format_, robot_mjcf, servers, policies)
    if share is not None:
        todo = share_of(todo, *share)
        if not todo:
            raise BadInput("this share holds no task")
    if dry_run:
        there = recorded_ids(out)
        left = [job for job in todo if job.episode_id not in there]
        say(f"{counted(todo)}, {len(todo) - len(left):,} of them in {out} already")
        for line in Estimate.of(left).lines(jobs):
            say(line)
        return
    watching = None
    if watched or stop_at_violation:
        from simulate.record.watch import Watching

        watching = Watching(watched, stop_at_violation)
    outcomes = []
    with progress(len(todo), "episode") as show:
        for outcome in run(todo, out, format_, jobs, show, watching, video=video):
            outcomes.append(outcome)
            say(f"[{len(outcomes)}/{len(todo)}] {outcome.episode_id}: {outcome}")
    say(summary(outcomes))
    failed = sum(bool(outcome.problem) for outcome in outcomes)
    if failed:
        raise BadInput(
            f"{failed} of {len(todo)} rollouts could not be recorded whole; start again to fill them in"
        )


def _campaign(
    file: Path,
    out: Path,
    format_: Any,
    robot_mjcf: Path | None,
    servers: tuple[str, ...],
    policies: tuple[str, ...],
) -> tuple[list[Any], Path, Any]:
    """Jobs, folder and format of a campaign; --out, --format and --policy go before the file's."""
    from simulate.record.campaign import read_campaign

    given = {
        name
        for name in click.get_current_context().params
        if click.get_current_context().get_parameter_source(name) is ParameterSource.COMMANDLINE
    }
    both = given & {"tasks", "seeds", "prompts", "rollouts", "horizon"}
    if both:
        raise click.UsageError(
            f"{', '.join(sorted(both))}: write it in {file}, or leave {file} out"
        )
    campaign = read_campaign(file)
    if "policies" in given:
        campaign = campaign.model_copy(update={"policies": policies})
    if campaign.out and "out" not in given:
        out = Path(campaign.out)
    if campaign.format and "format_" not in given:
        format_ = campaign.format
    addresses = dict(text.partition("=")[::2] for text in servers)
    return campaign.jobs(robot_mjcf, addresses), out, format_
