"""``safestage view``."""

from __future__ import annotations

import webbrowser
from functools import partial
from pathlib import Path

import click

from safestage_eval._text.plural import count

from .command_options import argument, option
from .command_options import command as make
from .outputs import Output
from .report_command import write_report
from .rule_choice import RuleChoice, rule_options
from .shared_options import (
    allow_host_option,
    chosen_ref,
    episode_argument,
    episode_option,
    jobs_option,
)
from .terminal import say, say_problems, serve_until_interrupted


@make("view")
def command(
    run: str = argument("RUN"),
    name: str | None = episode_argument,
    episode: str | None = episode_option,
    results: Path | None = option(
        "Take the verdicts from a file of safestage score, instead of judging.", metavar="FILE"
    ),
    output: Path | None = option(
        "Write files instead of serving: one page (NAME.html), or a folder.",
        "-o", of=Output("html", folder=True, emptied=True),
    ),
    open_: bool | None = option(
        "Open the browser, or do not.", "--open/--no-open", default=None
    ),
    port: int = option("Serve at this port. Default: a free one.", least=0, most=65535, default=0, show_default=False),
    allow_host: tuple[str, ...] = allow_host_option,
    everything: bool = option("Show rules that passed as well.", "--all", "-a"),
    by: RuleChoice = rule_options(roles=True),
    jobs: int | None = jobs_option,
) -> None:  # fmt: skip
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
    from safestage_eval.viewer.campaign.campaign_data import judged, rows_by_episode

    one = name is not None or episode is not None
    refs = [chosen_ref(run, name, episode)] if one else discover([run])
    asked = by.load()
    title = refs[0].episode_id or run if len(refs) == 1 else Path(run).name or run
    if output is None:
        from safestage_eval.viewer.live_run import LiveRun
        from safestage_eval.viewer.run_server import RunServer

        rows = None if results is None else rows_by_episode(results)
        live = LiveRun(title, refs, asked, rows=rows, everything=everything)
        server = RunServer(live, port, allow_host)
        say(f"{count(len(refs), 'episode')}; open the address below, end with Ctrl+C", err=True)
        serve_until_interrupted(server, browser=open_ is not False)
        return
    if results is not None:
        raise click.UsageError(
            "--results: files of scored episodes are written by safestage report"
        )
    make = partial(
        judged, refs, asked, title, run, jobs=jobs, everything=everything, sweep=len(refs) > 1
    )
    report, page = write_report(make, output, None)
    say(str(page))
    say_problems(report.pieces.problems if report.pieces is not None else ())
    if open_ and not webbrowser.open(page.resolve().as_uri()):
        say("no browser could be opened; open the file yourself", err=True)
