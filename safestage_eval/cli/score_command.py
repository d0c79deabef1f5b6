"""``safestage score``, alias ``safestage-score``."""

from __future__ import annotations

import shlex
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from safestage_eval._text.plural import count
from safestage_eval.report import FORMATS

from .command_options import command as make
from .command_options import option
from .outputs import Output, written
from .rule_choice import RuleChoice, rule_options
from .shared_options import (
    format_option,
    jobs_option,
    pairs,
    selected,
    traces_argument,
    where_option,
)
from .terminal import progress, say, table_looks

if TYPE_CHECKING:
    from safestage_eval.audit.audit import Audit
    from safestage_eval.report.golden import Change
    from safestage_eval.run.scores import Scores


def _beside(output: Path, given: dict[str, Any]) -> list[Path]:
    """The what-if table, where one is written."""
    from safestage_eval.whatif.flip_table import path_beside

    return [] if given["what_if"] is None else [path_beside(output)]


ADVANCED = (
    "protect", "update_golden", "assigned", "strict", "resume", "sample", "sample_seed", "timeout", "memory",
    "engine", "address", "what_if",
)  # fmt: skip

FAIL_ON = ("violation", "inconclusive", "unsafe-success", "not-judged")


@make("score", advanced=ADVANCED, context_settings={"help_option_names": ["-h", "--help"]})
def command(
    traces: tuple[str, ...] = traces_argument,
    by: RuleChoice = rule_options(roles=True),
    form: str = format_option(*FORMATS),
    output: Path | None = option(
        "Write to this file instead of stdout.", "-o", of=Output(beside=_beside)
    ),
    where: tuple[str, ...] = where_option,
    golden: Path | None = option(
        "Compare with expected verdicts; exit 1 and list the differences with their causes.",
        of=Output("json", in_dataset=True, when="update_golden"),
    ),
    update_golden: bool = option("Write the --golden file from these verdicts."),
    fail_on: tuple[str, ...] = option(
        "Exit 1 if any rule that counts gives this. Repeatable. not-judged: inconclusive, not loaded, "
        "unreadable, or no rule counts.",
        of=FAIL_ON,
    ),
    assigned: bool = option("Judge each episode by its assigned rules only (faster)."),
    strict: bool = option(
        "Refuse episodes whose columns contradict each other; count rules that these recordings can "
        "never decide as undecided, instead of setting them aside."
    ),
    jobs: int | None = jobs_option,
    resume: Path | None = option(
        "Store finished results in DIR; the same command continues where it stopped.",
        of=Output(file=False, folder=True), metavar="DIR",
    ),
    sample: int | None = option(
        "Judge only N episodes, spread over stages, tasks and policies.", least=1, metavar="N"
    ),
    sample_seed: int = option("Random seed for --sample.", default=0),
    timeout: float | None = option(
        "Abort an episode after SECONDS and list it as a problem. Default: 300 s of processor time.",
        of=click.FloatRange(0, min_open=True), metavar="SECONDS",
    ),
    memory: str | None = option(
        "Abort an episode whose worker exceeds SIZE, such as 800MB or 2GB.", metavar="SIZE"
    ),
    engine: str = option(
        "Run on local processes or on a Ray cluster (extra: cluster).",
        of=("local", "ray"), default="local",
    ),
    address: str | None = option(
        "Address of the Ray cluster. Default: $RAY_ADDRESS.", metavar="ADDRESS"
    ),
    what_if: str | None = option(
        "Write the what-if table beside the Parquet --output, for all parameters or those named.",
        metavar="all|NAMES",
    ),
    verbose: bool = option("List every episode, and what unassigned rules found.", "-v"),
) -> int:  # fmt: skip
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
    rows = form == "parquet" and output is not None
    on_terminal = output is None and sys.stdout.isatty()
    bound_here = by.assign or by.roles or by.protect
    for wrong, why in (
        (update_golden and not golden, "--update-golden needs --golden FILE"),
        (golden and where, "--golden is about all episodes: leave out --where"),
        (golden and sample, "--golden is about all episodes: leave out --sample"),
        (form == "parquet" and on_terminal, "--format parquet: give --output FILE, or pipe it on"),
        (what_if and not rows, "--what-if: write rows with --format parquet --output FILE"),
        (
            what_if and bound_here,
            "--what-if: write roles and rules into a --bind FILE (safestage import guess TRACES)",
        ),
        (address and engine != "ray", "--address is for --engine ray"),
    ):
        if wrong:
            raise click.UsageError(why)
    filters = pairs(where, "--where")
    from safestage_eval._process import heap, memory_limit
    from safestage_eval.audit.audit_scores import audit_scores, look
    from safestage_eval.report.golden import changes as changes_from
    from safestage_eval.run.bind_checks import misspelt_roles
    from safestage_eval.run.score_traces import Choice, score_traces
    from safestage_eval.run.scores import reasons

    most = None if memory is None else memory_limit.limit(memory)
    asked = by.load(assigned_only=assigned, strict=strict, timeout=timeout, memory=most)
    for warning in misspelt_roles(asked.bind, asked.rule_set):
        say(f"warning: {warning}", err=True)
    choice = Choice(filters, sample, sample_seed, resume, engine, address, jobs)
    with progress("scoring") as tell:
        heap.keep()
        scores = score_traces(traces, asked.copy_with(look=look), choice, tell)
    scores = replace(scores, reasons=reasons(asked.rule_set), strict=strict)
    audit = audit_scores(scores)
    if audit is not None:
        scores = replace(scores, audit=audit.plain)
    compared = golden is not None and not update_golden
    changes = changes_from(scores, golden) if golden is not None and compared else None
    by_audit = shlex.join(["safestage", "audit", *traces, *by.binding_options()])
    _say_first(scores, audit, by_audit, in_table=form == "table" and output is None)
    _write(scores, form, output, verbose, changes, traces)
    if what_if is not None and output is not None:
        _write_what_if(traces, where, by, jobs, what_if, output)
    failed = _fails(scores, fail_on)
    if golden is not None:
        failed |= _golden(scores, golden, changes)
    return 2 if scores.problems else 1 if failed else 0


def _say_first(scores: Scores, audit: Audit | None, by_audit: str, *, in_table: bool) -> None:
    """Say on stderr what is to be known before the results, which come last.

    ``by_audit``: the command that names the causes.
    """
    from safestage_eval.audit.audit_scores import in_one_line
    from safestage_eval.doubts.doubtful_columns import doubtful_columns
    from safestage_eval.report import results_text

    lines = [scores.sample]
    if not in_table or (sys.stderr.isatty() and not sys.stdout.isatty()):
        lines += results_text.problem_lines(scores)
    if not in_table:
        lines.append(results_text.judged_by_roles(scores))
        lines.append(results_text.ended_in_error(scores.aborted) if scores.aborted else "")
    lines.append("" if audit is None else in_one_line(audit, by_audit))
    if number := sum(problem.contradicts for problem in scores.problems):
        what = "contradicts itself" if number == 1 else "contradict themselves"
        lines.append(f"{count(number, 'recording')} {what}: {by_audit} names the likely cause")
    if doubtful := [columns for r in scores.results if (columns := doubtful_columns(r.notes))]:
        many = Counter(column for columns in doubtful for column in columns)
        said = ", ".join(f"{column} {number}" for column, number in many.most_common())
        lines.append(
            f"{count(len(doubtful), 'episode')} with doubtful columns ({said}): {by_audit}"
        )
    for line in filter(None, lines):
        say(line, err=True)


def _write(
    scores: Scores,
    form: str,
    output: Path | None,
    verbose: bool,
    changes: Sequence[Change] | None,
    traces: Sequence[str],
) -> None:
    from safestage_eval.report import pieces, results_text

    if form == "table":
        looks = table_looks(output)
        told = results_text.render(scores, everything=verbose, traces=" ".join(traces), **looks)
        written(told, output)
    else:
        written(pieces(scores, form, changes), output)
    if output is not None:
        say(f"{output}: {count(len(scores.results), 'episode')}", err=True)


def _write_what_if(
    traces: Sequence[str],
    where: tuple[str, ...],
    by: RuleChoice,
    jobs: int | None,
    params: str,
    output: Path,
) -> None:
    """Write the what-if table beside the rows; what cannot be judged is listed with them."""
    from safestage_eval.whatif.flip_table import Judging, path_beside, write_table

    names = [name.strip() for name in params.split(",") if name.strip()]
    judging = Judging(tuple(by.specs), by.overrides, None if by.bind is None else str(by.bind))
    beside, chosen = path_beside(output), None if names == ["all"] else names
    refs = selected(traces, where)
    with progress("what-if") as tell:
        write_table(beside, refs, judging, params=chosen, jobs=jobs, progress=tell)
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
            f"warning: --fail-on: no rule counts in {blind} of {count(len(scores.results), 'episode')}: "
            "nothing is assigned to them; name your rules with --rules, or add --fail-on not-judged",
            err=True,
        )  # fmt: skip
    total = len(scores.results) + len(scores.problems) + len(scores.aborted)
    matched = [name for name in counts if name in fail_on and counts[name]]
    for name in matched:
        say(f"--fail-on {name}: {counts[name]} of {count(total, 'episode')}", err=True)
    return bool(matched)


def _golden(scores: Scores, path: Path, changes: Sequence[Change] | None) -> bool:
    """Write the golden file, or say what differs from it; whether anything does."""
    if changes is None:
        from safestage_eval.report.golden import write_golden

        write_golden(scores, path)
        say(f"{path}: {count(len(scores.results), 'episode')} written", err=True)
        return False
    for change in changes:
        say(f"golden: {change}", err=True)
    outcome = count(len(changes), "difference") if changes else "all as expected"
    say(f"golden: {path}: {outcome}", err=True)
    return bool(changes)
