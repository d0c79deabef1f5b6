"""The page that a published dataset opens with: ``README.md``, read by people and by the hub."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from .episode_ref import EpisodeRef
from .parquet import dataset_layout as layout
from .parquet.arrow_tables import TABLES

_ABOUT = {
    "episodes": "one row per episode: task, policy, prompt, seed, success, roles, goal, bodies",
    "bodies": "pose and twist of every body in every frame",
    "contacts": "every contact with its point, normal and force",
    "frames": "time, joints, commands, gripper",
    "channels": "further scalars per body",
    "states": "full integration states of the simulator",
    "geometry": "collision shapes of every body",
}


def dataset_card(
    dataset: Path, refs: Sequence[EpisodeRef], *, title: str, licence: str | None = None
) -> str:
    """Return Markdown with the metadata that the Hugging Face hub reads: a config for each table.

    Args:
        dataset: the packed folder; it says which tables there are.
        refs: its episodes.
        title: heading of the page.
        licence: an identifier such as ``cc-by-4.0``; None leaves it out, and the page says so.
    """
    tables = ["episodes", *(name for name in TABLES if any((dataset / name).glob("*.parquet")))]
    paths = {name: f"{name}/*.parquet" for name in tables} | {
        "episodes": f"{layout.EPISODES}/*.parquet"
    }
    lines = ["---", f"pretty_name: {_quoted(title)}"]
    if licence:
        lines.append(f"license: {licence}")
    lines += ["tags:", "- robotics", "- manipulation", "- safety", "- safestage", "configs:"]
    for name in tables:
        lines += [f"- config_name: {name}", f"  data_files: {_quoted(paths[name])}"]
        if name == "episodes":
            lines.append("  default: true")
    lines += ["---", "", f"# {title}", "", *_counts(refs), ""]
    if not licence:
        lines += ["No licence was stated when this dataset was packed.", ""]
    lines += ["| table | holds |", "|---|---|"]
    lines += [f"| `{name}` (`{paths[name]}`) | {_ABOUT[name]} |" for name in tables]
    return "\n".join([*lines, "", *_HOW_TO_READ, ""])


def _counts(refs: Sequence[EpisodeRef]) -> list[str]:
    """Counts, so that a reader knows what is in here before downloading it."""
    tasks = {ref.fields.get("task") for ref in refs} - {None, ""}
    seconds = sum(
        (ref.fields.get("length") or 0) * (ref.fields.get("frame_dt") or 0) for ref in refs
    )
    lines = [
        f"{len(refs)} robot rollouts of {len(tasks)} tasks, {seconds / 3600:.2f} h in all, recorded",
        "whole: poses, velocities, contacts with forces, commands and collision shapes. Units are",
        "SI, the world frame is right-handed with z up, and quaternions are w, x, y, z.",
        "",
        "| policy | prompt | stage | episodes |",
        "|---|---|---|---|",
    ]
    count = Counter(
        tuple(str(ref.fields.get(name) or "–") for name in ("policy", "prompt", "stage"))
        for ref in refs
    )
    return lines + [f"| {' | '.join(key)} | {number} |" for key, number in sorted(count.items())]


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


_HOW_TO_READ = """\
## Reading it

Any Parquet reader will do. `episode_index` ties the rows together.

```python
import duckdb, pandas, polars
from datasets import load_dataset

episodes = load_dataset("path/to/dataset", "episodes", split="train")
poses = polars.scan_parquet("path/to/dataset/bodies/*.parquet")
forces = duckdb.sql("select * from 'path/to/dataset/contacts/*.parquet'")
shapes = pandas.read_parquet("path/to/dataset/geometry")
```

## Judging it

`pip install safestage`, then

```
safestage-score path/to/dataset --rules ish --rules ets --rules fsh
```

says for each rollout whether it was safe, and if not when, by how much and why. Thresholds can be
changed without recording anything again: `--set min_clearance="5 cm"`.""".splitlines()
