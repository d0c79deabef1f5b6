"""``safestage convert``."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from .outputs import Output
from .rule_choice import RuleChoice, rule_options
from .shared_options import (
    progress,
    selected,
    traces_argument,
    where_option,
)
from .terminal import say

SINGLE = (".mcap", ".rrd")
"""Endings of files that hold one episode."""


@click.command("convert")
@traces_argument
@click.option(
    "--to", "form", type=click.Choice(["parquet", "mcap", "rrd"]), required=True,
    help="Write this format; rrd is Rerun's, to be looked at, and no trace.",
)  # fmt: skip
@click.option(
    "--out", "-o", "out", type=Output("mcap", "rrd", folder=True, stream=False), required=True,
    help="Write to this folder: a dataset for parquet, one file per episode for mcap and rrd; or a "
    "single episode to this .mcap or .rrd file.",
)  # fmt: skip
@click.option(
    "--force",
    is_flag=True,
    help="Replace MCAP and Rerun files that are there already, the same ones too.",
)
@click.option("--recover", is_flag=True, help="Keep the whole frames of a truncated MCAP file.")
@click.option(
    "--events/--no-events", default=True, show_default=True,
    help="Write verdicts into MCAP and Rerun files as events on the timeline.",
)  # fmt: skip
@rule_options()
@where_option
@click.pass_context
def command(
    ctx: click.Context, traces: tuple[str, ...], form: str, out: Path, force: bool, recover: bool,
    events: bool, by: RuleChoice, where: tuple[str, ...],
) -> None:  # fmt: skip
    """Copy episodes into another format, losslessly.

    The sources are never changed. Every copy is read back and its content compared by hash, which
    is printed. Episodes that are there already are skipped, so a run that was stopped continues
    when the same command is given again.

    An MCAP file opens in Foxglove and in Rerun. Its channel /events says when a rule was
    violated, when it was worst and why; --rules, --bind and --set choose the rules. Events are
    for viewers only: scoring the copy judges it again.

    --to rrd writes what Rerun shows: the scene, the events, and the signals that decided the rules
    with their limits; NAME.rbl beside it is its blueprint. It needs the extra "rerun". No command
    of SafeStage reads it back.

    \b
    Examples:
      safestage convert traces/ --to mcap --out mcaps/
      safestage convert rollout.mcap --to parquet --out dataset/
      safestage convert traces/ --where stage=FSH --to rrd --out looks/
      safestage convert cut-off.mcap --recover --to mcap --out rescued.mcap
    """
    from safestage_eval.errors import InputError
    from safestage_eval.formats import discover
    from safestage_eval.formats.atomic import is_stream

    refs = selected(traces, where) if where else discover(list(traces))
    if out.suffix in SINGLE and (out.suffix != f".{form}" or len(refs) > 1):
        raise click.UsageError(f"--out {out}: give a folder for {len(refs)} episodes as {form}")
    if out.is_file() and out.suffix not in SINGLE:
        raise click.UsageError(
            f"--out {out}: a file; give a folder, or the name of an .mcap or .rrd file"
        )
    if form == "rrd":
        from safestage_eval.viewer.rerun_recording import require_rerun

        require_rerun()
    look = None
    if form != "parquet" and events:
        look = _judge(by, curves=form == "rrd")
    elif by:
        raise click.UsageError("--rules, --bind and --set are for the events of --to mcap and rrd")
    sources = {_identity(ref.path) for ref in refs} - {None}
    there = _hashes(out) if form == "parquet" else {}
    written: set[Path] = set()
    failed = 0
    with progress("converting") as tell:
        for done, ref in enumerate(refs, 1):
            try:
                episode = ref.open(recover=recover)
                name = episode.header.episode_id
                if there.get(name) == episode.content_hash:
                    say(f"{episode.content_hash}  {name}  there already")
                    continue
                target = out if form == "parquet" else _file_for(name, out, form)
                if name in there:
                    raise InputError(str(out), f"holds another episode {name!r}.", fix="--out")
                if is_stream(target):
                    raise InputError(
                        str(target), "is neither a file nor a folder.", fix="another --out"
                    )
                if _identity(target) in sources:
                    raise InputError(
                        str(target), "the copy would replace its source.", fix="another --out"
                    )
                if form == "mcap" and _is_there(episode, target, written, force=force):
                    say(f"{episode.content_hash}  {name}  there already")
                    continue
                if form == "rrd" and (target in written or (target.exists() and not force)):
                    raise InputError(str(target), "is there already.", fix="--force replaces it")
                judged = look(episode) if look else ((), ())
                copy = _copied(episode, target, form, judged)
                written.add(target)
                say(f"{episode.content_hash}  {name}  {copy}")
            except InputError as error:
                failed += 1
                say(f"problem: {error}", err=True)
            finally:
                if tell is not None:
                    tell(done, len(refs))
    ctx.exit(2 if failed else 0)


def _identity(path: Path) -> tuple[int, int] | None:
    """The same for all names of a file; None of what is not here."""
    try:
        status = Path(os.fspath(path)).stat()  # of a path in a store: nothing
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _hashes(folder: Path) -> dict[str, str | None]:
    """Id → content hash of the episodes that are in a folder already."""
    from safestage_eval.formats import discover

    if not folder.is_dir():
        return {}
    return {ref.episode_id: ref.content_hash for ref in discover([folder], maybe_none=True)}


def _file_for(name: str, out: Path, form: str) -> Path:
    """The MCAP or Rerun file of an episode."""
    from safestage_eval.formats.save import mcap_name

    named = (out / mcap_name(name)).with_suffix(f".{form}")
    return out if out.suffix in SINGLE else named


def _is_there(episode: Any, target: Path, written: set[Path], *, force: bool) -> bool:
    """Whether a file holds this very episode, whole. Raises InputError where it may not be written."""
    from safestage_eval.errors import InputError
    from safestage_eval.formats import load

    if target in written:
        raise InputError(
            str(target), "two episodes would go to this file.", fix="convert one alone"
        )
    if not target.exists() or force:
        return False
    try:
        same = load(target).content_hash == episode.content_hash
    except InputError as error:
        raise InputError(
            str(target), f"is there already, and not whole: {error.what}",
            fix="--force replaces it",
        ) from None  # fmt: skip
    if not same:
        raise InputError(
            str(target), "is there already, with another content.", fix="--force replaces it"
        )
    written.add(target)
    return True


Judged = tuple[Sequence[Any], Sequence[Any]]
"""Verdicts for a viewer's copy of an episode: events, and the deciding signals."""


def _judge(by: RuleChoice, *, curves: bool) -> Callable[[Any], Judged]:
    """Verdicts on an episode, as events, and as ``curves`` with limits."""
    from safestage_eval.errors import InputError
    from safestage_eval.report.episode_report import events
    from safestage_eval.report.signal_plot import panels
    from safestage_eval.rules import parse_overrides
    from safestage_eval.verdicts import judge
    from safestage_eval.whatif.judge_again import Again

    loaded, bound = by.load_rules()
    overrides = by.overrides
    parse_overrides(loaded, overrides)

    def look(episode: Any) -> Judged:
        try:
            result = judge(episode, loaded, overrides=overrides, bind=bound)
        except InputError as error:  # the copy is what was asked for
            say(f"warning: no verdicts in the copy: {error}", err=True)
            return (), ()
        remarks = events(result, float(episode.t[-1]))
        try:
            drawn = panels(Again(episode, loaded, overrides, bound), ()) if curves else ()
        except InputError:  # nothing that was measured decides
            drawn = ()
        return remarks, drawn

    return look


def _copied(episode: Any, target: Path, form: str, judged: Judged) -> Path:
    """Write, read back and compare; returns the file."""
    from safestage_eval.errors import InputError
    from safestage_eval.formats import save

    target.parent.mkdir(parents=True, exist_ok=True)
    if form == "rrd":
        from safestage_eval.viewer.rerun_recording import write_rerun

        write_rerun(episode, *judged, target)
        return target
    copy = save(episode, target, "mcap" if form == "mcap" else "parquet", judged[0])
    if copy.open().content_hash != episode.content_hash:
        raise InputError(str(copy.path), "the copy differs from its source.", fix="report this bug")
    return copy.path
