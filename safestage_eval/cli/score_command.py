"""``safestage score``, alias ``safestage-score``."""

from __future__ import annotations

import shlex
import shutil
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from safestage_eval._text.plural import count
from safestage_eval.report import FORMATS

from .outputs import Output
from .rule_choice import RuleChoice, rule_options
from .shared_options import (
    format_option,
    pairs,
    progress,
    selected,
    traces_argument,
    wants_color,
    where_option,
    written,
)
from .terminal import say

if TYPE_CHECKING:
    from safestage_eval.audit.audit import Audit
    from safestage_eval.formats import EpisodeRef
    from safestage_eval.report.golden import Change
    from safestage_eval.run.scores import Scores


def _beside(output: Path, given: dict[str, Any]) -> list[Path]:
    """The what-if table, where one is written."""
    from safestage_eval.whatif.flip_table import path_beside

    return [] if given["what_if"] is None else [path_beside(output)]


ADVANCED = (
    "protect", "update_golden", "assigned", "strict", "resume", "sample", "seed", "timeout", "memory",
    "engine", "address", "what_if", "limits",
)  # fmt: skip
"""Options that only ``--help-all`` shows."""


class Score(click.Command):
    """Shows few options in ``--help``, all of them in ``--help-all``."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Leave out what is advanced, unless it is asked for."""
        everything = ctx.meta.get("help-all", False)
        shown = [
            record
            for param in self.get_params(ctx)
            if isinstance(param, click.Option)
            and (everything or param.name not in ADVANCED)
            and (record := param.get_help_record(ctx))
        ]
        with formatter.section("Options"):
            formatter.write_dl(shown)


def _help_all(ctx: click.Context, _: click.Parameter, asked: bool) -> None:
    if asked:
        ctx.meta["help-all"] = True
        click.echo(ctx.get_help())
        ctx.exit()


FAIL_ON = ("violation", "inconclusive", "unsafe-success", "not-judged")


@click.command("score", cls=Score, context_settings={"help_option_names": ["-h", "--help"]})
@traces_argument
@rule_options(roles=True)
@format_option(*FORMATS)
@click.option(
    "--output", "-o", type=Output(beside=_beside), help="Write to this file instead of stdout."
)
@where_option
@click.option(
    "--golden", type=Output("json", in_dataset=True, when="update_golden"),
    help="Compare with expected verdicts; exit 1 and list the differences with their causes.",
)  # fmt: skip
@click.option("--update-golden", is_flag=True, help="Write the --golden file from these verdicts.")
@click.option(
    "--fail-on",
    multiple=True,
    type=click.Choice(FAIL_ON),
    help="Exit 1 if any rule that counts gives this. Repeatable. not-judged: inconclusive, not "
    "loaded, unreadable, or no rule counts.",
)
@click.option(
    "--assigned", is_flag=True,
    help="Judge each episode by its assigned rules only (faster).",
)  # fmt: skip
@click.option(
    "--strict", is_flag=True,
    help="Refuse episodes whose columns contradict each other; count rules that these recordings can "
    "never decide as undecided, instead of setting them aside.",
)  # fmt: skip
@click.option("--jobs", "-j", type=click.IntRange(1), help="Worker processes. Default: processors.")
@click.option(
    "--resume", type=Output(file=False, folder=True), metavar="DIR",
    help="Store finished results in DIR; the same command continues where it stopped.",
)  # fmt: skip
@click.option(
    "--sample", type=click.IntRange(1), metavar="N",
    help="Judge only N episodes, spread over stages, tasks and policies.",
)  # fmt: skip
@click.option("--sample-seed", "seed", type=int, default=0, help="Random seed for --sample.")
@click.option(
    "--timeout", type=click.FloatRange(0, min_open=True), metavar="SECONDS",
    help="Abort an episode after SECONDS and list it as a problem. Default: 300 s of processor time.",
)  # fmt: skip
@click.option(
    "--memory", metavar="SIZE", help="Abort an episode whose worker exceeds SIZE, such as 800MB or 2GB.",
)  # fmt: skip
@click.option(
    "--engine", type=click.Choice(("local", "ray")), default="local", show_default=True,
    help="Run on local processes or on a Ray cluster (extra: cluster).",
)  # fmt: skip
@click.option(
    "--address", metavar="ADDRESS", help="Address of the Ray cluster. Default: $RAY_ADDRESS."
)
@click.option(
    "--what-if", "what_if", metavar="all|NAMES",
    help="Write the what-if table beside the Parquet --output, for all parameters or those named.",
)  # fmt: skip
@click.option(
    "--verbose", "-v", is_flag=True, help="List every episode, and what unassigned rules found."
)
@click.option(
    "--help-all", is_flag=True, is_eager=True, expose_value=False, callback=_help_all,
    help="Show all options.",
)  # fmt: skip
@click.pass_context
def command(
    ctx: click.Context,
    traces: tuple[str, ...],
    by: RuleChoice,
    form: str,
    output: Path | None,
    where: tuple[str, ...],
    golden: Path | None,
    update_golden: bool,
    fail_on: tuple[str, ...],
    assigned: bool,
    strict: bool,
    jobs: int | None,
    resume: Path | None,
    sample: int | None,
    seed: int,
    timeout: float | None,
    memory: str | None,
    engine: str,
    address: str | None,
    what_if: str | None,
    verbose: bool,
) -> int:
    """Judge recorded episodes against safety rules.

    TRACES are MCAP files, datasets, or folders of them. Native success is reported apart from
    safety: SR = SSR + USR, where SSR counts successes that were safe and USR those that were not;
    VR counts violations. All four are over every recorded episode; where some are undecided, a rate
    is an interval.

    Findings of the rules that are assigned to an episode count for --fail-on, --golden, junit and
    github; so do those of every rule in a FILE that --rules names. Where neither header nor bind file
    nor --assign assigns rules, all loaded rules are assigned whose roles are bound.

    \b
    Examples:
      safestage-score traces/                        all built-in rules
      safestage-score traces/ --rules fsh            one stage
      safestage-score traces/ --assign FSH101 --role target=cube
      safestage-score traces/ --role target=cube --protect "vase,glass*"
      safestage-score traces/ --rules mine.toml      your own rules
      safestage-score traces/ --rules mine.toml --fail-on violation
      safestage-score traces/ --set edge="3 cm"      another threshold
      safestage-score traces/ --where policy=mine -f csv -o rows.csv
      safestage-score traces/ --golden expected.json --update-golden

    Exit code 0: scored. 1: the golden differs, or --fail-on matched. 2: bad usage, a rule file or
    a trace that cannot be read (the other episodes are scored all the same).
    """
    if update_golden and golden is None:
        raise click.UsageError("--update-golden needs --golden FILE")
    if golden is not None and where:
        raise click.UsageError("--golden is about all episodes: leave out --where")
    if form == "parquet" and output is None and sys.stdout.isatty():
        raise click.UsageError("--format parquet: give --output FILE, or pipe it on")
    if what_if is not None and (form != "parquet" or output is None):
        raise click.UsageError("--what-if: write rows with --format parquet --output FILE")
    if what_if is not None and (by.assign or by.roles or by.protect):
        raise click.UsageError(
            "--what-if: write roles and rules into a --bind FILE (safestage import guess TRACES)"
        )
    filters = pairs(where, "--where")
    if address is not None and engine != "ray":
        raise click.UsageError("--address is for --engine ray")
    if golden is not None and sample is not None:
        raise click.UsageError("--golden is about all episodes: leave out --sample")
    from safestage_eval._process import heap, memory_limit
    from safestage_eval.audit.audit_scores import audit_scores, look
    from safestage_eval.run.bind_checks import misspelt_roles
    from safestage_eval.run.score_traces import Choice, score_traces
    from safestage_eval.run.scores import reasons

    choice = Choice(filters, sample, seed, resume, engine, address, jobs)
    asked = by.load(
        assigned_only=assigned,
        strict=strict,
        timeout=timeout,
        memory=None if memory is None else memory_limit.limit(memory),
    )
    if asked.bind is not None:
        for warning in misspelt_roles(asked.bind, asked.rule_set):
            say(f"warning: {warning}", err=True)
    asked = asked.copy_with(look=look)
    with progress("scoring") as tell:
        heap.keep()
        scores = score_traces(traces, asked, choice, tell)
    scores = replace(scores, reasons=reasons(asked.rule_set), strict=strict)
    audit = audit_scores(scores)
    if audit is not None:
        scores = replace(scores, audit=audit.plain)
    if scores.sample:
        say(scores.sample, err=True)
    changes = None
    if golden is not None and not update_golden:
        from safestage_eval.report.golden import changes as changes_from

        changes = changes_from(scores, golden)
    by_audit = shlex.join(["safestage", "audit", *traces, *by.binding_options()])
    _messages(scores, audit, by_audit, in_table=form == "table" and output is None)
    _write(scores, form, output, verbose, changes, traces)
    if what_if is not None and output is not None:
        _write_what_if(selected(traces, where), by, jobs, what_if, output)
    failed = _fails(scores, fail_on)
    if golden is not None:
        failed |= _golden(scores, golden, changes)
    ctx.exit(2 if scores.problems else 1 if failed else 0)


def _messages(scores: Scores, audit: Audit | None, by_audit: str, *, in_table: bool) -> None:
    """Say on stderr what is to be known before the results, which come last.

    ``by_audit``: the command that names the causes.
    """
    from safestage_eval.audit.audit_scores import in_one_line
    from safestage_eval.doubts.doubtful_columns import doubtful_columns
    from safestage_eval.report import results_text

    if not in_table or (sys.stderr.isatty() and not sys.stdout.isatty()):
        for line in results_text.problem_lines(scores):
            say(line, err=True)
    if not in_table and (said := results_text.judged_by_roles(scores)):
        say(said, err=True)
    if scores.aborted and not in_table:
        say(results_text.ended_in_error(scores.aborted), err=True)
    if audit is not None and (in_short := in_one_line(audit, by_audit)):
        say(in_short, err=True)
    if number := sum(problem.contradicts for problem in scores.problems):
        what = "contradicts itself" if number == 1 else "contradict themselves"
        say(
            f"{count(number, 'recording')} {what}: {by_audit} names the likely cause",
            err=True,
        )
    if doubtful := [columns for r in scores.results if (columns := doubtful_columns(r.notes))]:
        many = Counter(column for columns in doubtful for column in columns)
        said = ", ".join(f"{column} {number}" for column, number in many.most_common())
        say(
            f"{count(len(doubtful), 'episode')} with doubtful columns ({said}): {by_audit}",
            err=True,
        )


def _write(
    scores: Scores,
    form: str,
    output: Path | None,
    verbose: bool,
    changes: Sequence[Change] | None,
    traces: Sequence[str],
) -> None:
    from safestage_eval.report import pieces

    if form == "table":
        from safestage_eval.report import render_text, results_text

        text: Iterable[str | bytes] = results_text.render(
            scores,
            width=None if output else shutil.get_terminal_size((render_text.WIDTH, 24)).columns,
            color=output is None and wants_color(sys.stdout),
            everything=verbose,
            traces=" ".join(traces),
        )
    else:
        text = pieces(scores, form, changes)
    written(text, output)
    if output is not None:
        say(f"{output}: {count(len(scores.results), 'episode')}", err=True)


def _write_what_if(
    refs: Sequence[EpisodeRef],
    by: RuleChoice,
    jobs: int | None,
    params: str,
    output: Path,
) -> None:
    """Write the what-if table beside the rows; what cannot be judged is listed with them."""
    from safestage_eval.whatif.flip_table import Judging, path_beside, write_table

    names = [name.strip() for name in params.split(",") if name.strip()]
    bind = None if by.bind is None else str(by.bind)
    judging = Judging(tuple(by.specs), by.overrides, bind)
    beside = path_beside(output)
    with progress("what-if") as tell:
        write_table(
            beside, refs, judging, params=None if names == ["all"] else names, jobs=jobs, progress=tell,
        )  # fmt: skip
    say(f"{beside}: what-if table", err=True)


def _fails(scores: Scores, fail_on: tuple[str, ...]) -> bool:
    counts = dict.fromkeys(FAIL_ON, 0)
    gates, blind = scores.gates, 0
    for r in scores.results if fail_on else ():
        counted, violation = bool(gates.counted(r)), gates.violation(r)
        blind += not counted
        counts["violation"] += violation is True
        counts["inconclusive"] += counted and violation is None
        counts["unsafe-success"] += bool(violation and r.success)
        counts["not-judged"] += violation is None
    counts["not-judged"] += len(scores.problems) + len(scores.aborted)
    if blind and "not-judged" not in fail_on:
        say(
            f"warning: --fail-on: no rule counts in {blind} of "
            f"{count(len(scores.results), 'episode')}: nothing "
            "is assigned to them; name your rules with --rules, or add --fail-on not-judged",
            err=True,
        )
    total = len(scores.results) + len(scores.problems) + len(scores.aborted)
    matched = [name for name in counts if name in fail_on and counts[name]]
    for name in matched:
        say(f"--fail-on {name}: {counts[name]} of {count(total, 'episode')}", err=True)
    return bool(matched)


def _golden(scores: Scores, path: Path, changes: Sequence[Change] | None) -> bool:
    if changes is None:
        from safestage_eval.report.golden import write_golden

        write_golden(scores, path)
        say(f"{path}: {count(len(scores.results), 'episode')} written", err=True)
        return False
    for change in changes:
        say(f"golden: {change}", err=True)
    number = len(changes)
    outcome = f"{number} difference{'s' * (number > 1)}" if changes else "all as expected"
    say(f"golden: {path}: {outcome}", err=True)
    return bool(changes)
