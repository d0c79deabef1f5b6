"""``safestage audit``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from safestage_eval._text.plural import count

from .command_options import argument, option
from .command_options import command as make
from .outputs import written
from .rule_choice import RuleChoice, rule_options
from .shared_options import (
    format_option,
    jobs_option,
    output_option,
    pairs,
    selected,
    where_option,
)
from .terminal import progress, say, say_problems, table_looks

if TYPE_CHECKING:
    from safestage_eval.formats import EpisodeRef


@make("audit")
def command(
    traces: tuple[str, ...] = argument("TRACES..."),
    by: RuleChoice = rule_options(roles=True, values=False),
    form: str = format_option("table", "json", "junit", "github", "sarif"),
    output: Path | None = output_option,
    where: tuple[str, ...] = where_option,
    select: tuple[str, ...] = option(
        "Carry out these checks alone: codes, or how they begin (AUD1), with commas. Repeatable.",
        metavar="CODES",
    ),
    ignore: tuple[str, ...] = option("Leave these checks out. Repeatable.", metavar="CODES"),
    fail_on: str = option(
        "Exit 1 if anything is as grave as this.", of=("error", "warning", "never"), default="error"
    ),
    files: bool = option(
        "Say of each file whether it is whole and as it was written, with its hash; nothing else."
    ),
    explain: str | None = option("Explain a check, and do nothing else.", metavar="CODE"),
    jobs: int | None = jobs_option,
    verbose: bool = option("In the table: write every finding out.", "-v"),
) -> int:
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
      safestage audit --files traces/ rollout.mcap

    --files reads every column: format, finite numbers, unit quaternions, increasing time, contacts
    that name bodies, stored hashes, ids that two episodes share. Use it after copying.

    Exit code 0: audited. 1: --fail-on matched. 2: bad usage, a rule file or a trace that cannot be
    read (the other episodes are audited all the same).
    """
    from safestage_eval.audit import audit, choose
    from safestage_eval.report import audit_report

    if explain is not None:
        written("\n".join(map(audit_report.explain, choose([explain]))), output)
        return 0
    if not traces:
        raise click.UsageError("Missing argument 'TRACES...'.")
    if files:
        return 0 if _whole(traces, where, by) else 2
    with progress("auditing") as tell:
        result = audit(
            traces, by.rules, bind=by.bind, assign=by.assign, roles=by.roles, protect=by.protect,
            where=pairs(where, "--where"), select=_codes(select), ignore=_codes(ignore), jobs=jobs,
            progress=tell,
        )  # fmt: skip
    looks = table_looks(output)
    written(audit_report.render(result, form, everything=verbose, **looks), output)
    if form != "table" or output is not None:
        say_problems(result.problems)
        say(audit_report.headline(result), err=True)
    return 2 if result.problems else 1 if result.fails(fail_on) else 0


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
                    bound = bind_episode(settings.rule_set, header, bind=settings.bind)
                    warnings = list(bound.warnings())
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
