"""``safestage label sheets``."""

from __future__ import annotations

import csv
from pathlib import Path

import click

from safestage_eval.cli.outputs import Output
from safestage_eval.cli.rule_choice import RuleChoice, rule_options
from safestage_eval.cli.shared_options import selected, traces_argument, where_option
from safestage_eval.cli.terminal import say

from .simulate_options import BadInput, explains, progress

folder_argument = click.argument(
    "folder", type=click.Path(path_type=Path, file_okay=False, exists=True)
)


@click.group()
def sheets() -> None:
    """Draw rollouts as picture sheets, to be judged without seeing a verdict.

    For reviewers without a browser, for papers, and for vision models. See docs/labels.md.
    """


@sheets.command()
@traces_argument
@click.option(
    "--out",
    type=Output(file=False, folder=True),
    required=True,
    help="Folder for label_sample.csv, NNN_a.png (front), _b (side), _c (top) and NNN.txt.",
)
@click.option("--sample", "-n", "count", type=click.IntRange(1), metavar="N",
              help="Number of rollouts, spread evenly over the stages. Default: all.")  # fmt: skip
@click.option("--seed", type=int, default=0, show_default=True, help="Sampling seed.")
@click.option(
    "--list",
    "listed",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    help="CSV file with a column episode_id: draw these rollouts in this order.",
)
@click.option("--hide-success", is_flag=True,
              help="Do not show whether and when the goal was reached, so that readers can judge it.")  # fmt: skip
@rule_options(values=False)
@where_option
@explains
def draw(
    traces: tuple[str, ...],
    out: Path,
    count: int | None,
    seed: int,
    listed: Path | None,
    hide_success: bool,
    by: RuleChoice,
    where: tuple[str, ...],
) -> None:
    """Draw sheets of rollouts, numbered in random order; existing sheets are kept.

    \b
    Examples:
      safestage label sheets draw runs/ --out study --sample 240
      safestage label sheets draw rollout.mcap --out pictures
    """
    from safestage_eval.label import sample
    from simulate.study.study import draw as drawn
    from simulate.study.study import number

    loaded, bound = by.load_rules()
    refs = [ref for ref in selected(traces, where) if not ref.problem]
    if listed is None:
        chosen = sample(refs, count, seed)
    else:
        by_id = {ref.episode_id: ref for ref in refs}
        with listed.open(newline="", encoding="utf-8") as handle:
            names = [row.get("episode_id", "") for row in csv.DictReader(handle)][:count]
        missing = [name for name in names if name not in by_id]
        if missing:
            raise BadInput(f"{listed}: not among the traces: {', '.join(missing[:5])}")
        chosen = [by_id[name] for name in names]
    if not chosen:
        raise BadInput(f"{' '.join(traces)}: no episode can be read")
    numbered = number(chosen, out)
    with progress(len(chosen), "rollout") as show:
        pairs = zip(numbered, chosen, strict=True)
        new = drawn(pairs, out, loaded, bound, show, hide_success=hide_success)
    say(f"{out}: {new} drawn, {len(chosen) - new} there already")


@sheets.command("close-up")
@folder_argument
@click.argument("number", type=int)
@click.option("--from", "start", type=float, required=True, metavar="S", help="First moment.")
@click.option("--to", "end", type=float, required=True, metavar="S", help="Last moment.")
@click.option("--count", type=click.IntRange(1, 60), default=12, show_default=True)
@click.option(
    "--view",
    type=click.Choice(["side", "front", "top", "robot"]),
    default="side",
    show_default=True,
)
@click.option("--zoom", multiple=True, metavar="BODY", help="Body to follow closely. Repeatable.")
@click.option("--output", "-o", type=Output("png"), required=True)
@rule_options(values=False)
@explains
def close_up(
    folder: Path,
    number: int,
    start: float,
    end: float,
    count: int,
    view: str,
    zoom: tuple[str, ...],
    output: Path,
    by: RuleChoice,
) -> None:
    """Look closer at a rollout of FOLDER by its NUMBER, without learning which it is.

    \b
    Example:
      safestage label sheets close-up study 17 --from 3.1 --to 3.6 --zoom cup -o cup.png
    """
    from simulate.render.renderer import write_png
    from simulate.study.study import look

    loaded, bound = by.load_rules()
    image = look(
        folder, number, loaded, bound, start=start, end=end, count=count, view=view, zoom=zoom
    )
    write_png(image, output)
    say(f"{output}: {image.shape[1]} x {image.shape[0]} pixels")


@sheets.command()
@folder_argument
@click.argument(
    "answers", nargs=-1, required=True, type=click.Path(path_type=Path, dir_okay=False, exists=True)
)
@click.option(
    "--labels", "-l", "file", type=Output("csv"),
    default=Path("labels.csv"), show_default=True, help="Where labels are kept; a CSV file.",
)  # fmt: skip
@explains
def enter(folder: Path, answers: tuple[Path, ...], file: Path) -> None:
    """Turn ANSWERS by number (number,label,reviewer,note) into labels by episode.

    \b
    Example:
      safestage label sheets enter study ada.csv ben.csv --labels labels.csv
    """
    from safestage_eval.label import Ledger
    from simulate.study.study import enter as entered

    say(f"{file}: {entered(folder, answers, Ledger(file))} labels entered")
