"""``safestage label sheets``."""

from __future__ import annotations

import csv
from pathlib import Path

import click

from safestage_eval.cli.command_options import argument, command, option
from safestage_eval.cli.outputs import Output
from safestage_eval.cli.rule_choice import RuleChoice, rule_options
from safestage_eval.cli.shared_options import selected, traces_argument, where_option
from safestage_eval.cli.terminal import say

from .simulate_options import BadInput, explains, progress

FOLDER = argument("FOLDER", type=click.Path(path_type=Path, file_okay=False, exists=True))


@click.group()
def sheets() -> None:
    """Draw rollouts as picture sheets, to be judged without seeing a verdict.

    For reviewers without a browser, for papers, and for vision models. See docs/labels.md.
    """


@command("draw")
@explains
def draw(
    traces: tuple[str, ...] = traces_argument,
    out: Path = option(
        "Folder for label_sample.csv, NNN_a.png (front), _b (side), _c (top) and NNN.txt.",
        of=Output(file=False, folder=True), required=True,
    ),
    count: int | None = option(
        "Number of rollouts, spread evenly over the stages. Default: all.", "--sample", "-n", least=1,
        metavar="N",
    ),
    seed: int = option("Sampling seed.", default=0),
    listed: Path | None = option(
        "CSV file with a column episode_id: draw these rollouts in this order.", "--list",
        of=click.Path(path_type=Path, dir_okay=False, exists=True),
    ),
    hide_success: bool = option(
        "Do not show whether and when the goal was reached, so that readers can judge it."
    ),
    by: RuleChoice = rule_options(values=False),
    where: tuple[str, ...] = where_option,
) -> None:  # fmt: skip
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


@command("close-up")
@explains
def close_up(
    folder: Path = FOLDER,
    number: int = argument("NUMBER"),
    start: float = option("First moment.", "--from", required=True, metavar="S"),
    end: float = option("Last moment.", "--to", required=True, metavar="S"),
    count: int = option("", least=1, most=60, default=12),
    view: str = option("", of=("side", "front", "top", "robot"), default="side"),
    zoom: tuple[str, ...] = option("Body to follow closely. Repeatable.", metavar="BODY"),
    output: Path = option("", "-o", of=Output("png"), required=True),
    by: RuleChoice = rule_options(values=False),
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


@command("enter")
@explains
def enter(
    folder: Path = FOLDER,
    answers: tuple[Path, ...] = argument(
        "ANSWERS...", required=True, type=click.Path(path_type=Path, dir_okay=False, exists=True)
    ),
    file: Path = option(
        "Where labels are kept; a CSV file.",
        "--labels",
        "-l",
        of=Output("csv"),
        default=Path("labels.csv"),
    ),
) -> None:
    """Turn ANSWERS by number (number,label,reviewer,note) into labels by episode.

    \b
    Example:
      safestage label sheets enter study ada.csv ben.csv --labels labels.csv
    """
    from safestage_eval.label import Ledger
    from simulate.study.study import enter as entered

    say(f"{file}: {entered(folder, answers, Ledger(file))} labels entered")


for below in (draw, close_up, enter):
    sheets.add_command(below)
