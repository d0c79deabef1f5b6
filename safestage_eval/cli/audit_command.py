"""``safestage audit``."""

from __future__ import annotations

import shlex
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from safestage_eval._text.plural import count

from .rule_choice import RuleChoice, rule_options
from .shared_options import (
    format_option,
    output_option,
    pairs,
    progress,
    say_problems,
    selected,
    wants_color,
    where_option,
    written,
)
from .terminal import say

if TYPE_CHECKING:
    from safestage_eval.formats import EpisodeRef


@click.command("audit")
@click.argument("traces", nargs=-1, metavar="TRACES...")
@rule_options(roles=True, values=False)
@format_option("table", "json", "junit", "github", "sarif")
@output_option
@where_option
@click.option(
    "--select", multiple=True, metavar="CODES",
    help="Carry out these checks alone: codes, or how they begin (AUD1), with commas. Repeatable.",
)  # fmt: skip
@click.option(
    "--ignore", multiple=True, metavar="CODES", help="Leave these checks out. Repeatable."
)
@click.option(
    "--fail-on", type=click.Choice(("error", "warning", "never")), default="error",
    show_default=True, help="Exit 1 if anything is as grave as this.",
)  # fmt: skip
@click.option(
    "--files", is_flag=True,
    help="Say of each file whether it is whole and as it was written, with its hash; nothing else.",
)  # fmt: skip
@click.option("--explain", metavar="CODE", help="Explain a check, and do nothing else.")
@click.option("--jobs", "-j", type=click.IntRange(1), help="Worker processes. Default: processors.")
@click.option("--verbose", "-v", is_flag=True, help="In the table: write every finding out.")
@click.pass_context
def command(
    ctx: click.Context,
    traces: tuple[str, ...],
    by: RuleChoice,
    form: str,
    output: Path | None,
    where: tuple[str, ...],
    select: tuple[str, ...],
    ignore: tuple[str, ...],
    fail_on: str,
    files: bool,
    explain: str | None,
    jobs: int | None,
    verbose: bool,
) -> None:
    """Say whether recordings, their scenes and the evaluation they make are sound.

    Finds centimetres for metres, milliseconds for seconds, holes, quaternions in another order,
    misspelt roles, rules that do not exist, scenes that start broken, and
    evaluations that prove nothing. Each finding has a code, a place, a likely cause and a fix;
    docs/audit.md lists them all.

    \b
    Examples:
      safestage audit traces/
      safestage audit traces/ --rules mine.toml --fail-on warning
      safestage audit traces/ --select AUD1 --ignore AUD117
      safestage audit traces/ --format junit --output audit.xml
      safestage audit --explain AUD104
      safestage audit --files traces/ rollout.mcap

    --files reads every column: format, unit quaternions, increasing time, contacts
    that name bodies, stored hashes, ids that two episodes share. Use it after copying.

    Exit code 0: audited. 1: --fail-on matched. 2: bad usage, a rule file or a trace that cannot be
    read (the other episodes are audited all the same).
    """
    from safestage_eval.audit import audit, choose
    from safestage_eval.report import audit_report, results_text

    if explain is not None:
        written("\n".join(map(audit_report.explain, choose([explain]))), output)
        return
    if not traces:
        raise click.UsageError("Missing argument 'TRACES...'.")
    if files:
        ctx.exit(0 if _whole(traces, where, by) else 2)
    with progress("auditing") as tell:
        result = audit(
            traces,
            by.rules,
            bind=by.bind,
            assign=by.assign,
            roles=by.roles,
            protect=by.protect,
            where=pairs(where, "--where"),
            select=_codes(select),
            ignore=_codes(ignore),
            jobs=jobs,
            progress=tell,
        )
    width = None if output else shutil.get_terminal_size((results_text.WIDTH, 24)).columns
    color = output is None and wants_color(sys.stdout)
    written(audit_report.render(result, form, width=width, color=color, everything=verbose), output)
    if form != "table" or output is not None:
        say_problems(result.problems)
        say(audit_report.headline(result), err=True)
    ctx.exit(2 if result.problems else 1 if result.fails(fail_on) else 0)


def _whole(traces: tuple[str, ...], where: tuple[str, ...], by: RuleChoice) -> bool:
    """Print a line for each file, and whether all are whole, and as they were written."""
    from safestage_eval.errors import RuleError
    from safestage_eval.formats import discover, validate_episode
    from safestage_eval.rules.episode_binding import bind_episode

    settings = by.load()
    refs, broken = selected(traces, where) if where else discover(list(traces)), 0
    first: dict[str, EpisodeRef] = {}
    with progress("checking") as tell:
        for done, ref in enumerate(refs, 1):
            problems = [str(error) for error in validate_episode(ref)]
            same = first.setdefault(ref.episode_id or ref.shown, ref)
            if same is not ref and same.content_hash != ref.content_hash:
                problems.append(f"{ref.shown}: another episode has this id as well: {same.shown}")
            broken += bool(problems)
            for problem in problems:
                say(f"error: {problem}", err=True)
            if not problems:
                try:
                    header = ref.open().header
                    warnings = bind_episode(
                        settings.rule_set, header, bind=settings.bind
                    ).warnings()
                except RuleError as error:
                    warnings = [str(error)]
                for warning in warnings:
                    say(f"warning: {ref.shown}: {warning}", err=True)
                say(f"{ref.content_hash or '(no hash stored)'}  {ref.episode_id}  {ref.shown}")
            if tell is not None:
                tell(done, len(refs))
    say(f"{len(refs) - broken} of {count(len(refs), 'episode')} whole, and as written", err=True)
    if not broken:
        by_audit = shlex.join(["safestage", "audit", *traces, *by.binding_options()])
        say(f"{by_audit} says whether what they record makes sense", err=True)
    return not broken


def _codes(given: tuple[str, ...]) -> list[str]:
    return [code.strip() for codes in given for code in codes.split(",") if code.strip()]
