"""``safestage convert``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from safestage_eval.errors import InputError

from .command_options import command as make
from .command_options import option
from .outputs import Output
from .rule_choice import RuleChoice, rule_options
from .shared_options import selected, traces_argument, where_option
from .terminal import progress, say

SINGLE = (".mcap", ".rrd")
"""Endings of files that hold one episode."""


@make("convert")
def command(
    traces: tuple[str, ...] = traces_argument,
    form: str = option(
        "Write this format; rrd is Rerun's, to be looked at, and no trace.",
        "--to", of=("parquet", "mcap", "rrd"), required=True,
    ),
    out: Path = option(
        "Write to this folder: a dataset for parquet, one file per episode for mcap and rrd; or a "
        "single episode to this .mcap or .rrd file.",
        "-o", of=Output("mcap", "rrd", folder=True, stream=False), required=True,
    ),
    force: bool = option(
        "Replace MCAP and Rerun files that are there already, the same ones too."
    ),
    recover: bool = option("Keep the whole frames of a truncated MCAP file."),
    events: bool = option(
        "Write verdicts into MCAP and Rerun files as events on the timeline.",
        "--events/--no-events", default=True, show_default=True,
    ),
    by: RuleChoice = rule_options(),
    where: tuple[str, ...] = where_option,
) -> int:  # fmt: skip
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
    from safestage_eval.formats import discover

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
    if by and (form == "parquet" or not events):
        raise click.UsageError("--rules, --bind and --set are for the events of --to mcap and rrd")
    look = _judge(by, curves=form == "rrd") if events and form != "parquet" else None
    copies, failed = _Copies(form, out, [ref.path for ref in refs], force=force), 0
    with progress("converting") as tell:
        for done, ref in enumerate(refs, 1):
            try:
                episode = ref.open(recover=recover)
                copied = copies.add(episode, look)
                say(f"{episode.content_hash}  {episode.header.episode_id}  {copied}")
            except InputError as error:
                failed += 1
                say(f"problem: {error}", err=True)
            if tell is not None:
                tell(done, len(refs))
    return 2 if failed else 0


Judged = tuple[Sequence[Any], Sequence[Any]]
"""Verdicts for a viewer's copy of an episode: events, and the deciding signals."""

Look = Callable[[Any], Judged]


class _Copies:
    """Writes copies where nothing else is, and says of each where it is."""

    def __init__(self, form: str, out: Path, sources: Sequence[Path], *, force: bool) -> None:
        from safestage_eval.formats import discover

        self._form, self._out, self._force = form, out, force
        self._sources = {_identity(path) for path in sources} - {None}
        self._written: set[Path] = set()
        self._there: dict[str, str | None] = {}
        if form == "parquet" and out.is_dir():
            there = discover([out], maybe_none=True)
            self._there = {ref.episode_id: ref.content_hash for ref in there}

    def add(self, episode: Any, look: Look | None) -> str:
        """Where the copy of an episode is now. Raises InputError where it may not be written."""
        from safestage_eval.formats.atomic import is_stream
        from safestage_eval.formats.save import mcap_name

        name, target = episode.header.episode_id, self._out
        if self._form == "parquet":
            if self._there.get(name) == episode.content_hash:
                return "there already"
            if name in self._there:
                raise InputError(str(target), f"holds another episode {name!r}.", fix="--out")
        elif target.suffix not in SINGLE:
            target = (target / mcap_name(name)).with_suffix(f".{self._form}")
        if is_stream(target):
            raise InputError(str(target), "is neither a file nor a folder.", fix="another --out")
        if _identity(target) in self._sources:
            raise InputError(str(target), "the copy would replace its source.", fix="another --out")
        if target in self._written:
            raise InputError(
                str(target), "two episodes would go to this file.", fix="convert one alone"
            )
        if self._form != "parquet":
            self._written.add(target)
            if target.exists() and not self._force:
                return self._found(episode, target)
        target.parent.mkdir(parents=True, exist_ok=True)
        return str(self._copied(episode, target, look(episode) if look else ((), ())))

    def _found(self, episode: Any, target: Path) -> str:
        """Raises InputError unless a file holds this very episode, whole."""
        from safestage_eval.formats import load

        why = "is there already."
        if self._form == "mcap":
            try:
                if load(target).content_hash == episode.content_hash:
                    return "there already"
                why = "is there already, with another content."
            except InputError as error:
                why = f"is there already, and not whole: {error.what}"
        raise InputError(str(target), why, fix="--force replaces it")

    def _copied(self, episode: Any, target: Path, judged: Judged) -> Path:
        """Write, read back and compare."""
        from safestage_eval.formats import save

        if self._form == "rrd":
            from safestage_eval.viewer.rerun_recording import write_rerun

            write_rerun(episode, *judged, target)
            return target
        copy = save(episode, target, "mcap" if self._form == "mcap" else "parquet", judged[0])
        if copy.open().content_hash != episode.content_hash:
            what = "the copy differs from its source."
            raise InputError(str(copy.path), what, fix="report this bug")
        return copy.path


def _identity(path: Path) -> tuple[int, int] | None:
    """Device and inode of a file, the same for all its names; None if it does not exist."""
    try:
        status = Path(str(path)).stat()  # of a path in a store: nothing
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _judge(by: RuleChoice, *, curves: bool) -> Look:
    """Verdicts on an episode, as events, and as ``curves`` with limits."""
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
