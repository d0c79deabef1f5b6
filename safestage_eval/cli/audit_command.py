"""``safestage audit``."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import click

from .rule_choice import RuleChoice, rule_options
from .shared_options import (
    format_option,
    output_option,
    pairs,
    prepare_kernels,
    progress,
    say_problems,
    wants_color,
    where_option,
    written,
)
from .terminal import say


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
    explain: str | None,
    jobs: int | None,
    verbose: bool,
) -> None:
    """Say whether recordings, their scenes and the evaluation they make are sound.

    Finds centimetres for metres, milliseconds for seconds, holes, quaternions in another order,
    misspelt roles, rules that do not exist or cannot be decided, scenes that start broken, and
    evaluations that prove nothing. Each finding has a code, a place, a likely cause and a fix;
    docs/audit.md lists them all.

    \b
    Examples:
      safestage audit traces/
      safestage audit traces/ --rules mine.toml --fail-on warning
      safestage audit traces/ --select AUD1 --ignore AUD117
      safestage audit traces/ --format junit --output audit.xml
      safestage audit --explain AUD104

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
    prepare_kernels()
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


def _codes(given: tuple[str, ...]) -> list[str]:
    return [code.strip() for codes in given for code in codes.split(",") if code.strip()]
