"""``safestage view``."""

from __future__ import annotations

import webbrowser
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .outputs import Output
from .report_command import write_report
from .rule_choice import RuleChoice, rule_options
from .shared_options import (
    allow_host_option,
    chosen_ref,
    episode_argument,
    episode_option,
    jobs_option,
    say_problems,
    serve_until_interrupted,
)
from .terminal import say

if TYPE_CHECKING:
    from safestage_eval.formats import EpisodeRef
    from safestage_eval.run.settings import Settings


@click.command("view")
@click.argument("run", metavar="RUN")
@episode_argument
@episode_option
@click.option(
    "--results", type=click.Path(path_type=Path), metavar="FILE",
    help="Take the verdicts from a file of safestage score, instead of judging.",
)  # fmt: skip
@click.option(
    "--output", "-o", type=Output("html", folder=True, emptied=True),
    help="Write files instead of serving: one page (NAME.html), or a folder.",
)  # fmt: skip
@click.option("--open/--no-open", "open_", default=None, help="Open the browser, or do not.")
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, help="Serve at this port. Default: a free one."
)  # fmt: skip
@allow_host_option
@click.option("--all", "-a", "everything", is_flag=True, help="Show rules that passed as well.")
@rule_options(roles=True)
@jobs_option
def command(
    run: str,
    name: str | None,
    episode: str | None,
    results: Path | None,
    output: Path | None,
    open_: bool | None,
    port: int,
    allow_host: tuple[str, ...],
    everything: bool,
    by: RuleChoice,
    jobs: int | None,
) -> None:
    """Look at episodes in the browser: a list, a 3-D player, signals with limits, findings.

    RUN is an MCAP file, a dataset, or a folder of them; EPISODE chooses one of it. A server for this
    machine alone judges the episodes while you look at them; Ctrl+C ends it. With --output, the
    same pages are written as files, which need neither server nor network.

    \b
    Examples:
      safestage view traces/
      safestage view traces/ EPISODE_ID --set min_clearance="5 cm"
      safestage view runs/ --results rows.parquet
      safestage view rollout.mcap --output episode.html
    """
    from safestage_eval.formats import discover

    one = name is not None or episode is not None
    refs = [chosen_ref(run, name, episode)] if one else discover([run])
    asked = by.load()
    title = refs[0].episode_id or run if len(refs) == 1 else Path(run).name or run
    if output is None:
        _serve(
            refs,
            asked,
            title,
            results,
            port,
            names=allow_host,
            everything=everything,
            open_=open_ is not False,
        )
        return
    if results is not None:
        raise click.UsageError(
            "--results: files of scored episodes are written by safestage report"
        )
    from safestage_eval.viewer.campaign.campaign_data import judged

    make = partial(
        judged, refs, asked, title, run, jobs=jobs, everything=everything, sweep=len(refs) > 1
    )
    report, page = write_report(make, output, None)
    say(str(page))
    say_problems(report.pieces.problems if report.pieces is not None else ())
    if open_ and not webbrowser.open(page.resolve().as_uri()):
        say("no browser could be opened; open the file yourself", err=True)


def _serve(
    refs: Sequence[EpisodeRef],
    settings: Settings,
    title: str,
    results: Path | None,
    port: int,
    *,
    names: tuple[str, ...],
    everything: bool,
    open_: bool,
) -> None:
    from safestage_eval._text.plural import count
    from safestage_eval.viewer.live_run import LiveRun
    from safestage_eval.viewer.run_server import RunServer

    rows = None
    if results is not None:
        from safestage_eval.viewer.campaign.campaign_data import rows_by_episode

        rows = rows_by_episode(results)
    server = RunServer(
        LiveRun(title, refs, settings, rows=rows, everything=everything), port, names
    )
    said = count(len(refs), "episode")
    say(f"{said}; open the address below, end with Ctrl+C", err=True)
    serve_until_interrupted(server, browser=open_)
