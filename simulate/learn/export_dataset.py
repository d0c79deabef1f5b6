"""Recordings judged and made a LeRobot dataset, in as many processes as there are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef
from safestage_eval.rules import RuleSet, load_rules
from safestage_eval.verdicts import judge

from .lerobot_writer import LeRobotWriter, Part

Work = Callable[[EpisodeRef], "Part | str | None"]
Spread = Callable[[Work, Sequence[EpisodeRef]], Iterable[object]]
"""Does the work on every recording, in order; what is neither part, text nor None says why it failed."""


@dataclass(frozen=True)
class Exported:
    """Outcome of an export of recordings.

    Attributes:
        kept: episodes in the dataset.
        steps: their control steps.
        left_out: episodes that did not reach their goal.
        problems: why others could not be exported.
    """

    kept: int
    steps: int
    left_out: int
    problems: tuple[str, ...]


def export_dataset(
    refs: Sequence[EpisodeRef], out: Path, *, failures: bool = False, spread: Spread = map
) -> Exported:
    """Write recordings as one dataset; ``failures``: those that did not reach their goal as well.

    Raises InputError where the folder is not empty, or nothing is left to write.
    """
    writer = LeRobotWriter(out)
    kept = steps = left_out = 0
    problems = []
    for part in spread(partial(part_of, failures=failures), refs):
        if isinstance(part, Part):
            kept += 1
            steps += writer.add(part)
        elif part is None:
            left_out += 1
        else:
            problems.append(part if isinstance(part, str) else str(getattr(part, "reason", part)))
    writer.close()
    return Exported(kept, steps, left_out, tuple(problems))


def part_of(ref: EpisodeRef, *, failures: bool) -> Part | str | None:
    """A recording for the dataset; None where it did not reach its goal, a text if something is wrong."""
    try:
        episode = ref.open()
        if not (episode.header.success or failures):
            return None
        return Part.of(episode, judge(episode, _rules(), assigned_only=True).violation)
    except InputError as error:
        return str(error)


@cache
def _rules() -> RuleSet:
    return load_rules(["ish", "ets", "fsh", "goals"])
