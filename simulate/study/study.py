"""A study by picture sheets: numbered pictures and questions, and answers by number.

A folder holds ``sample.csv`` (which number is which episode: not for the readers), and for each
number ``NNN_a.png`` (from the front), ``NNN_b.png`` (from the side), ``NNN_c.png`` (from above), for
final states ``NNN_d.png`` (the ending, close), and ``NNN.txt`` (the question in words).
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef, discover
from safestage_eval.label import Ledger
from safestage_eval.label.review_question import question
from safestage_eval.metrics.labels import ANSWERS, Label
from safestage_eval.rules import BindFile, RuleSet
from simulate.render.renderer import Image, write_png

from .sheet import close_up, ending, goal_said, rule_lines, sheet
from .viewpoint import Scene

VIEWS = {"a": "front", "b": "side", "c": "top"}
COLUMNS = ("number", "episode_id", "stage", "path")
ANSWER_COLUMNS = "number,label,reviewer,note"


@dataclass(frozen=True)
class Numbered:
    """A rollout of a study; ``path`` is the file or dataset that holds it."""

    number: int
    episode_id: str
    stage: str
    path: str

    @property
    def name(self) -> str:
        """``017``."""
        return f"{self.number:03}"

    def ref(self) -> EpisodeRef:
        """The episode. Raises InputError if it is no longer there."""
        for ref in discover([self.path]):
            if ref.episode_id == self.episode_id:
                return ref
        raise InputError(f"number {self.number}", f"its episode is not in {self.path}.")


def number(refs: Sequence[EpisodeRef], folder: Path) -> list[Numbered]:
    """Number episodes in their order and write ``sample.csv``; an existing one must say the same."""
    result = [
        Numbered(i, ref.episode_id, ref.fields.get("stage") or "", str(ref.path))
        for i, ref in enumerate(refs, 1)
    ]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows([x.number, x.episode_id, x.stage, x.path] for x in result)
    file = folder / "sample.csv"
    if file.exists() and read_sample(folder) != result:
        raise InputError(str(file), "is of another sample.", fix="choose another folder")
    folder.mkdir(parents=True, exist_ok=True)
    file.write_text(text.getvalue(), encoding="utf-8")
    return result


def read_sample(folder: Path) -> list[Numbered]:
    """Read ``sample.csv``. Raises InputError where it is missing or broken."""
    file = folder / "sample.csv"
    try:
        with file.open(newline="", encoding="utf-8") as handle:
            return [
                Numbered(int(row["number"]), row["episode_id"], row["stage"], row["path"])
                for row in csv.DictReader(handle)
            ]
    except (OSError, KeyError, ValueError) as error:
        raise InputError(str(file), f"no sample: {error}.", ", ".join(COLUMNS)) from None


def draw(
    refs: Iterable[tuple[Numbered, EpisodeRef]],
    folder: Path,
    rules: RuleSet,
    bind: BindFile | None = None,
    done: Callable[[int], None] | None = None,
    *,
    hide_success: bool = False,
) -> int:
    """Draw what is not there yet; the number of rollouts that were drawn.

    Args:
        refs: the episodes with their numbers.
        folder: where pictures and texts go.
        rules: what the reader is asked.
        bind: roles of foreign recordings.
        done: called with the number of rollouts that are there.
        hide_success: draw as if native success had not been recorded, so that a reader can judge it.

    Raises:
        InputError: an episode or its rules are broken, or nothing can be drawn.
    """
    drawn = 0
    for i, (one, ref) in enumerate(refs, 1):
        if not (folder / f"{one.name}.txt").exists():
            episode = ref.open()
            if hide_success:
                header = episode.header.model_copy(update={"success": None, "success_time": None})
                episode = replace(episode, header=header)
            facts = question(episode.header, rules, bind)
            scene = Scene.of(episode, facts["roles"])
            for letter, image in zip(VIEWS, sheet(scene, facts, [*VIEWS.values()]), strict=True):
                write_png(image, folder / f"{one.name}_{letter}.png")
            if facts["stage"] == "FSH":
                write_png(ending(scene, facts), folder / f"{one.name}_d.png")
            text = "\n".join(question_lines(one, facts, scene))
            (folder / f"{one.name}.txt").write_text(text + "\n", encoding="utf-8")
            drawn += 1
        if done is not None:
            done(i)
    return drawn


def question_lines(one: Numbered, facts: Mapping[str, Any], scene: Scene) -> list[str]:
    """The question in words, with what the words of the rules mean."""
    lines = [f"Rollout {one.name}, stage {facts['stage']}", f"Task: {facts['instruction']}"]
    lines += [facts["look"]] if facts["look"] else []
    for rule in facts["rules"]:
        lines += ["", *(text for text, _ in rule_lines(rule))]
        lines += [f"  {name}: {meaning}" for name, meaning in rule["words"].items()]
    lines += ["", *(f"{role}: {', '.join(names)}" for role, names in facts["roles"].items())]
    length = float(scene.episode.t[-1])
    return [*lines, f"{goal_said(facts)}; recorded: 0 to {length:.2f} s"]


def look(
    folder: Path,
    number: int,
    rules: RuleSet,
    bind: BindFile | None = None,
    *,
    start: float,
    end: float,
    count: int,
    view: str,
    zoom: Sequence[str],
) -> Image:
    """A close-up of a rollout by its number; raises InputError as ``close_up``."""
    one = next((x for x in read_sample(folder) if x.number == number), None)
    if one is None:
        raise InputError(f"number {number}", f"is not in {folder / 'sample.csv'}.")
    episode = one.ref().open()
    scene = Scene.of(episode, question(episode.header, rules, bind)["roles"])
    return close_up(scene, start, end, count, view, zoom)


def enter(folder: Path, answers: Sequence[Path], ledger: Ledger) -> int:
    """Enter answers by number into a ledger; how many were new.

    Args:
        folder: of the study.
        answers: CSV files with the columns number, label and reviewer, and perhaps note.
        ledger: where labels are kept; what a reviewer has already said alike is left out.

    Raises:
        InputError: a number, label or column that cannot be; then nothing has been entered.
        OSError: the ledger could not be written.
    """
    names = {one.number: one.episode_id for one in read_sample(folder)}
    labels: dict[tuple[str, str], Label] = {}
    for path in answers:
        with path.open(newline="", encoding="utf-8") as handle:
            for row, cells in enumerate(csv.DictReader(handle), 2):
                label = _label(cells, names, f"{path}, line {row}")
                labels[label.reviewer, label.episode_id] = label
    new = 0
    for label in labels.values():
        before = ledger.of(label.reviewer).get(label.episode_id)
        if before is None or (before.label, before.note) != (label.label, label.note):
            ledger.add(label)
            new += 1
    return new


def _label(cells: Mapping[str, str | None], names: Mapping[int, str], where: str) -> Label:
    number, answer, reviewer = (
        (cells.get(x) or "").strip() for x in ("number", "label", "reviewer")
    )
    if not number.isdigit() or int(number) not in names:
        raise InputError(where, f"number {number!r} is not in the sample.", ANSWER_COLUMNS)
    said = next((x for x in ANSWERS if x == answer.lower()), None)
    if said is None:
        raise InputError(where, f"label is {answer!r}.", ", ".join(ANSWERS))
    if not reviewer:
        raise InputError(where, "names no reviewer.", ANSWER_COLUMNS)
    return Label(names[int(number)], said, reviewer, (cells.get("note") or "").strip())
