"""``safestage convert``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from .shared_options import (
    bind_option,
    loaded_rules,
    pairs,
    prepare_kernels,
    progress,
    rules_option,
    set_option,
    traces_argument,
)
from .terminal import say


@click.command("convert")
@traces_argument
@click.option(
    "--to", "form", type=click.Choice(["parquet", "mcap"]), required=True, help="Write this format."
)
@click.option(
    "--out", "-o", "out", type=click.Path(path_type=Path), required=True,
    help="Write to this folder: a dataset for parquet, one file per episode for mcap; or a single "
    "episode to this .mcap file.",
)  # fmt: skip
@click.option(
    "--force", is_flag=True, help="Replace MCAP files that are there already, the same ones too."
)
@click.option("--recover", is_flag=True, help="Keep the whole frames of a truncated MCAP file.")
@click.option(
    "--events/--no-events", default=True, show_default=True,
    help="Write verdicts into MCAP files as events on the timeline.",
)  # fmt: skip
@rules_option
@bind_option
@set_option
@click.pass_context
def command(
    ctx: click.Context, traces: tuple[str, ...], form: str, out: Path, force: bool, recover: bool,
    events: bool, rules: tuple[str, ...], bind: Path | None, settings: tuple[str, ...],
) -> None:  # fmt: skip
    """Copy episodes into another format, losslessly.

    The sources are never changed. Every copy is read back and its content compared by hash, which
    is printed. Episodes that are there already are skipped, so a run that was stopped continues
    when the same command is given again.

    An MCAP file opens in Foxglove and in Rerun. Its channel /events says when a rule was
    violated, when it was worst and why; --rules, --bind and --set choose the rules. Events are
    for viewers only: scoring the copy judges it anew.

    \b
    Examples:
      safestage convert traces/ --to mcap --out mcaps/
      safestage convert rollout.mcap --to parquet --out dataset/
      safestage convert cut-off.mcap --recover --to mcap --out rescued.mcap
    """
    from safestage_eval.errors import InputError
    from safestage_eval.formats import discover

    refs = discover(list(traces))
    if out.suffix == ".mcap" and (form != "mcap" or len(refs) > 1):
        raise click.UsageError(f"--out {out}: give a folder for {len(refs)} episodes as {form}")
    if out.is_file() and out.suffix != ".mcap":
        raise click.UsageError(f"--out {out}: a file; give a folder, or the name of an .mcap file")
    remarks = None
    if form == "mcap" and events:
        remarks = _judge(rules, bind, settings)
    elif rules or bind or settings:
        raise click.UsageError("--rules, --bind and --set are for the events of --to mcap")
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
                target = out if form == "parquet" else _file_for(name, out)
                if name in there:
                    raise InputError(str(out), f"holds another episode {name!r}.", fix="--out")
                if form == "mcap" and _is_there(episode, target, ref.path, written, force=force):
                    say(f"{episode.content_hash}  {name}  there already")
                    continue
                copy = _copied(episode, target, form, remarks(episode) if remarks else ())
                written.add(target)
                say(f"{episode.content_hash}  {name}  {copy}")
            except InputError as error:
                failed += 1
                say(f"problem: {error}", err=True)
            finally:
                if tell is not None:
                    tell(done, len(refs))
    ctx.exit(2 if failed else 0)


def _hashes(folder: Path) -> dict[str, str | None]:
    """Id → content hash of the episodes that are in a folder already."""
    from safestage_eval.formats import discover

    if not folder.is_dir():
        return {}
    return {ref.episode_id: ref.content_hash for ref in discover([folder], maybe_none=True)}


def _file_for(name: str, out: Path) -> Path:
    """The MCAP file of an episode."""
    from safestage_eval.formats.save import mcap_name

    return out if out.suffix == ".mcap" else out / mcap_name(name)


def _is_there(episode: Any, target: Path, source: Path, written: set[Path], *, force: bool) -> bool:
    """Whether a file holds this very episode, whole. Raises InputError where it may not be written."""
    from safestage_eval.errors import InputError
    from safestage_eval.formats import load

    if target.resolve() == source.resolve():
        raise InputError(str(target), "the copy would replace its source.", fix="another --out")
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


def _judge(
    rules: tuple[str, ...], bind: Path | None, settings: tuple[str, ...]
) -> Callable[[Any], Sequence[Any]]:
    """Verdicts on an episode, as events."""
    from safestage_eval.errors import InputError
    from safestage_eval.report.verdict_events import events
    from safestage_eval.rules import parse_overrides
    from safestage_eval.verdicts import judge

    loaded, bound = loaded_rules(rules, bind)
    overrides = pairs(settings, "--set")
    parse_overrides(loaded, overrides)
    prepare_kernels()

    def remarks(episode: Any) -> Sequence[Any]:
        try:
            result = judge(episode, loaded, overrides=overrides, bind=bound)
        except InputError as error:  # the copy is what was asked for
            say(f"warning: no verdicts in the copy: {error}", err=True)
            return ()
        return events(result, float(episode.t[-1]))

    return remarks


def _copied(episode: Any, target: Path, form: str, events: Sequence[Any]) -> Path:
    """Write, read back and compare; returns the file."""
    from safestage_eval.errors import InputError
    from safestage_eval.formats import save

    target.parent.mkdir(parents=True, exist_ok=True)
    copy = save(episode, target, "mcap" if form == "mcap" else "parquet", events)
    if copy.open().content_hash != episode.content_hash:
        raise InputError(str(copy.path), "the copy differs from its source.", fix="report this bug")
    return copy.path
