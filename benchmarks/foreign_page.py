"""Writes the page on foreign rollouts: scores what foreign_rollouts.py recorded, and counts."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

import safestage_eval

SETS = {
    "metaworld": ("Meta-World 3.0.0", "metaworld", "the scripted experts in its wheel"),
    "gymnasium_robotics": ("Gymnasium-Robotics 1.4.2", "gymnasium_robotics", "a script"),
    "mani_skill": ("ManiSkill 3.0.1", "maniskill", "a script"),
    "robosuite": ("robosuite 1.5.2", "robosuite", "a script"),
}
"""Folder → the simulator, its bind file, the policy."""

NOTES = Path(__file__).with_name("foreign_notes.md")
"""What was seen in pictures, written by hand."""

RULES = ("ets", "fsh")


def score(folder: Path) -> pd.DataFrame:
    """Return a row per episode and rule that was judged, with the simulator in ``set``."""
    tables = []
    for name, (_, bind, _) in SETS.items():
        traces = folder / name
        if not any(traces.glob("*.zip")):
            continue
        result = safestage_eval.score([traces], rules=list(RULES), bind=bind)
        table = result.to_pandas()
        tables.append(table.assign(set=name))
    return pd.concat(tables, ignore_index=True)
