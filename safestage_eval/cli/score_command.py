"""``safestage score``, alias ``safestage-score``."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from safestage_eval._text.plural import count
from safestage_eval.report import FORMATS

from .rule_choice import RuleChoice, rule_options
from .shared_options import (
    format_option,
    pairs,
    prepare_kernels,
    progress,
    selected,
    traces_argument,
    unusable,
    wants_color,
    where_option,
    written,
)
from .terminal import say

if TYPE_CHECKING:
    from safestage_eval.formats import EpisodeRef
    from safestage_eval.report.golden import Change
    from safestage_eval.rules import RuleSet
    from safestage_eval.run.scores import Scores

FAIL_ON = ("violation", "inconclusive", "unsafe-success", "not-judged")


@click.command("score", context_settings={"help_option_names": ["-h", "--help"]})
@traces_argument
@rule_options(roles=True)
@format_option(*FORMATS)
@click.option(
    "--output", "-o", type=click.Path(path_type=Path), help="Write to this file instead of stdout."
)
@where_option
@click.option(
    "--golden", type=click.Path(path_type=Path),
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
    "--clearance-backend", "backend", type=click.Choice(("gjk", "fcl", "coal")), default="gjk",
    show_default=True, help="Clearance library; fcl and coal are for comparison.",
)  # fmt: skip
@click.option(
    "--assigned", is_flag=True,
    help="Judge each episode by its assigned rules only (faster).",
)  # fmt: skip
@click.option(
    "--cache", type=click.Path(file_okay=False, path_type=Path), metavar="DIR",
    envvar="SAFESTAGE_CACHE",
    help="Store measurements in DIR, so that scoring again reads no traces. Default: $SAFESTAGE_CACHE.",
)  # fmt: skip
@click.option("--no-cache", is_flag=True, help="Neither read nor write $SAFESTAGE_CACHE.")
@click.option("--jobs", "-j", type=click.IntRange(1), help="Worker processes. Default: processors.")
@click.option(
    "--resume", type=click.Path(file_okay=False, path_type=Path), metavar="DIR",
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
    "--manifest", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE",
    help="Write what was judged, how and by what, ready to be signed, to FILE; needs --output.",
)  # fmt: skip
@click.option(
    "--verbose", "-v", is_flag=True, help="In the table: every episode, and other stages' findings."
)
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
    backend: str,
    assigned: bool,
    cache: Path | None,
    no_cache: bool,
    jobs: int | None,
    resume: Path | None,
    sample: int | None,
    seed: int,
    timeout: float | None,
    memory: str | None,
    engine: str,
    address: str | None,
    what_if: str | None,
    manifest: Path | None,
    verbose: bool,
) -> int:
    """Judge recorded episodes against safety rules.

    TRACES are MCAP files, datasets, or folders of them. Native success is reported apart from
    safety: SR = SSR + USR, where SSR counts successes that were safe and USR those that were not;
    VR counts violations. All four are over the episodes that could be decided.

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
            "--what-if: write roles and rules into a --bind FILE (safestage bind --init TRACES)"
        )
    if manifest is not None and output is None:
        raise click.UsageError("--manifest is about a file of results: give --output FILE")
    filters = pairs(where, "--where")
    if address is not None and engine != "ray":
        raise click.UsageError("--address is for --engine ray")
    if golden is not None and sample is not None:
        raise click.UsageError("--golden is about all episodes: leave out --sample")
    from safestage_eval._process import heap, memory_limit
    from safestage_eval.audit.audit_scores import audit_scores, in_one_line, look
    from safestage_eval.run.bind_checks import misspelt_roles
    from safestage_eval.run.score_traces import Choice, score_traces
    from safestage_eval.run.scores import reasons

    kept = None if no_cache else cache
    if kept is not None and (why := unusable(kept)):
        say(f"--cache {kept}: {why}; nothing is kept there", err=True)
    choice = Choice(filters, sample, seed, resume, engine, address, jobs)
    asked = by.load(
        backend=backend,
        assigned_only=assigned,
        cache=kept,
        timeout=timeout,
        memory=None if memory is None else memory_limit.limit(memory),
    )
    if asked.bind is not None:
        for warning in misspelt_roles(asked.bind, asked.rule_set):
            say(f"warning: {warning}", err=True)
    asked = asked.copy_with(look=look)
    with progress("scoring") as tell:
        heap.keep()
        scores = score_traces(traces, asked, choice, tell, prepare_kernels)
    scores = replace(scores, reasons=reasons(asked.rule_set))
    audit = audit_scores(scores)
    if audit is not None:
        scores = replace(scores, audit=audit.plain)
    if scores.sample:
        say(scores.sample, err=True)
    changes = None
    if golden is not None and not update_golden:
        from safestage_eval.report.golden import changes as changes_from

        changes = changes_from(scores, golden)
    _write(scores, form, output, verbose, changes)
    if manifest is not None and output is not None:
        more = {"backend": backend, "assigned_only": assigned, "where": filters}
        stated = {**by.stated(), **more}
        _write_manifest(manifest, output, traces, scores, asked.rule_set, stated)
    if what_if is not None and output is not None:
        _write_what_if(selected(traces, where), by, jobs, what_if, output)
    from safestage_eval.report import results_text

    in_table = form == "table" and output is None  # there already, unless it went to another place
    if not in_table or (sys.stderr.isatty() and not sys.stdout.isatty()):
        for line in results_text.problem_lines(scores):
            say(line, err=True)
    if not in_table and (said := results_text.judged_by_roles(scores)):
        say(said, err=True)
    if scores.aborted and not in_table:
        say(results_text.ended_in_error(scores.aborted), err=True)
    if audit is not None and (in_short := in_one_line(audit, " ".join(traces))):
        say(in_short, err=True)
    if number := sum(problem.contradicts for problem in scores.problems):
        what = "contradicts itself" if number == 1 else "contradict themselves"
        say(
            f"{count(number, 'recording')} {what}: safestage audit {' '.join(traces)} names the likely "
            "cause",
            err=True,
        )
    failed = _fails(scores, fail_on)
    if golden is not None:
        failed |= _golden(scores, golden, changes)
    ctx.exit(2 if scores.problems else 1 if failed else 0)


def _write(
    scores: Scores,
    form: str,
    output: Path | None,
    verbose: bool,
    changes: Sequence[Change] | None,
) -> None:
    from safestage_eval.report import pieces

    if form == "table":
        from safestage_eval.report import results_text

        text: Iterable[str | bytes] = results_text.render(
            scores,
            width=None if output else shutil.get_terminal_size((results_text.WIDTH, 24)).columns,
            color=output is None and wants_color(sys.stdout),
            everything=verbose,
        )
    else:
        text = pieces(scores, form, changes)
    written(text, output)
    if output is not None:
        say(f"{output}: {count(len(scores.results), 'episode')}", err=True)


def _write_manifest(
    file: Path,
    output: Path,
    traces: tuple[str, ...],
    scores: Scores,
    rules: RuleSet,
    settings: dict[str, Any],
) -> None:
    """Write the manifest; the digests of all episodes are computed, which reads them whole."""
    from safestage_eval.formats import discover
    from safestage_eval.provenance.manifest import as_bytes, digest_of, manifest

    judged = {(result.path, result.episode_id) for result in scores.results}
    refs = [ref for ref in discover(list(traces)) if (ref.shown, ref.episode_id) in judged]
    subject = {output.name: digest_of(output)}
    problems = [Path(problem.path).name for problem in scores.problems]
    written(as_bytes(manifest(subject, rules, settings, refs, problems)), file)
    say(f"{file}: manifest of {count(len(refs), 'episode')}", err=True)


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
