"""``safestage validate``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from safestage_eval._text.plural import count

from .rule_choice import RuleChoice, rule_options
from .shared_options import progress, traces_argument
from .terminal import say

if TYPE_CHECKING:
    from safestage_eval.formats import EpisodeRef
    from safestage_eval.rules import BindFile, RuleSet


@click.command("validate")
@traces_argument
@rule_options(values=False)
@click.pass_context
def command(ctx: click.Context, traces: tuple[str, ...], by: RuleChoice) -> None:
    """Check trace files: are they whole, and as they were written?

    Reads every column: format, finite numbers, unit quaternions, increasing time, contacts that
    name bodies, stored hashes, ids that two episodes share. Exit code 2 if anything is wrong. Warns
    where no header or bind file names the bodies that an assigned rule is about.

    Use it after copying or converting. Whether what was recorded can be true (units, velocities
    against poses, contacts, forces) and what it proves is for: safestage audit.

    \b
    Example:
      safestage validate traces/ rollout.mcap
    """
    from safestage_eval.formats import discover, validate_episode

    loaded, bound = by.load_rules()
    refs = discover(list(traces))
    broken = 0
    first: dict[str, Any] = {}
    with progress("checking") as tell:
        for done, ref in enumerate(refs, 1):
            problems = [str(error) for error in validate_episode(ref)]
            same = first.setdefault(ref.episode_id or ref.shown, ref)
            if same is not ref and same.content_hash != ref.content_hash:
                problems.append(f"{ref.shown}: another episode has this id as well: {same.shown}")
            broken += bool(problems)
            for problem in problems:
                say(f"error: {problem}", err=True)
            for warning in () if problems else _warnings(ref, loaded, bound):
                say(f"warning: {ref.shown}: {warning}", err=True)
            if not problems:
                say(f"{ref.content_hash or '(no hash stored)'}  {ref.episode_id}  {ref.shown}")
            if tell is not None:
                tell(done, len(refs))
    say(f"{len(refs) - broken} of {count(len(refs), 'episode')} whole, and as written", err=True)
    if broken < len(refs):
        say(
            f"safestage audit {' '.join(traces)} says whether what they record makes sense",
            err=True,
        )
    ctx.exit(2 if broken else 0)


def _warnings(ref: EpisodeRef, rules: RuleSet, bind: BindFile | None) -> list[str]:
    """Warnings for a sound episode: reasons why its assigned rules cannot be judged."""
    from safestage_eval.errors import RuleError
    from safestage_eval.rules.episode_binding import bind_episode

    try:
        return bind_episode(rules, ref.open().header, bind=bind).warnings()
    except RuleError as error:
        return [str(error)]
