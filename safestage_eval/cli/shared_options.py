"""Arguments that several commands share, and what they mean."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from safestage_eval._text.line_width import LINE_WIDTH

from .command_options import argument, option
from .outputs import Output

if TYPE_CHECKING:
    from safestage_eval.formats import EpisodeRef

traces_argument = argument("TRACES...", required=True)

where_option = option(
    "Select episodes by header field: policy=…, task=…, prompt=…, seed=…. Repeatable.",
    "--where", metavar="FIELD=VALUE",
)  # fmt: skip

episode_argument = argument("[EPISODE]", required=False)

episode_option = option(
    "Choose an episode by its id, or a unique part of it, where TRACE holds several.",
    "--episode", "-e", metavar="ID",
)  # fmt: skip


def _unfolded(_: click.Context, __: click.Parameter, output: Path | None) -> Path | None:
    if output is not None:
        LINE_WIDTH.set(None)
    return output


output_option = option(
    "Write to this file instead of stdout.", "--output", "-o", of=Output(), callback=_unfolded
)

jobs_option = option(
    "Use N worker processes. Default: one per processor.", "--jobs", "-j", least=1, metavar="N"
)

allow_host_option = option(
    "Answer under this host name too, and pages from it. Repeatable. "
    "Default: loopback names and the address reached.",
    "--allow-host", metavar="NAME[:PORT]",
)  # fmt: skip

random_seed_option = option("Seed the bootstrap.", least=0, default=0)


def format_option(*formats: str) -> Any:
    """``--format`` with these choices, the first one by default."""
    return option("", "--format", "-f", of=formats, default=formats[0])


def pairs(
    values: tuple[str, ...], option: str, allowed: Sequence[str] | None = None
) -> dict[str, str]:
    """``("a=b",)`` → ``{"a": "b"}``; anything else, or a name that is not allowed, is a usage error."""
    out = {}
    for value in values:
        name, equals, text = value.partition("=")
        if not equals or not name.strip():
            raise click.UsageError(f"{option} {value}: write NAME=VALUE")
        if allowed is not None and name.strip() not in allowed:
            raise click.UsageError(f"{option} {name.strip()}: there are {', '.join(allowed)}")
        out[name.strip()] = text.strip()
    return out


def selected(traces: Iterable[str], where: tuple[str, ...]) -> list[EpisodeRef]:
    """The episodes of ``TRACES...`` that ``--where`` selects."""
    from safestage_eval.formats import discover
    from safestage_eval.formats.episode_filter import Selection

    return [*Selection(discover(list(traces)), pairs(where, "--where"))]


MOST_IDS = 20
"""Ids of episodes that a message lists."""


def chosen_ref(trace: str, name: str | None, episode: str | None) -> EpisodeRef:
    """The one episode a command is about; a usage error lists the ids when it is not clear.

    ``name`` and ``episode`` are two ways to say which: as an argument, and as ``--episode``.
    """
    from safestage_eval.formats import discover

    if name is not None and episode is not None:
        raise click.UsageError(f"{name} or --episode {episode}: name the episode once")
    wanted = episode or name or ""
    refs = discover([trace])
    exact = [ref for ref in refs if wanted and ref.episode_id == wanted]
    matches = exact or [ref for ref in refs if wanted in ref.episode_id]
    if len(matches) == 1:
        return matches[0]
    from safestage_eval._text.printable import printable
    from safestage_eval.errors import shortened

    ids = [ref.episode_id or f"({ref.shown}, broken)" for ref in matches or refs]
    problem = "several episodes; name one with --episode"
    if not matches:
        from difflib import get_close_matches

        near = get_close_matches(wanted, ids, 3)
        near = near or [one for one in ids if get_close_matches(wanted, one.split("."), 1)]
        problem = f"no episode {wanted!r}" + (", did you mean" if near else ", but")
        ids = near or ids
    shown = "".join(f"\n  {printable(shortened(one, 200))}" for one in ids[:MOST_IDS])
    more = f"\n  and {len(ids) - MOST_IDS} more" if len(ids) > MOST_IDS else ""
    raise click.UsageError(f"{trace} holds {problem}:{shown}{more}")
