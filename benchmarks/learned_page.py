"""Writes docs/learned_policies.md: what learned policies do on held-out seeds.

python benchmarks/learned_page.py ROWS.parquet docs/learned_policies.md
"""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path

CHECKPOINTS = Path(__file__).parents[1] / "simulate" / "learn" / "checkpoints"
NOTES = Path(__file__).with_name("learned_notes.md")
"""Written by hand: what was tried, and what the rates do not show."""


def printed_by(*arguments: str) -> str:
    """Output of a command of safestage as Markdown."""
    code = "from safestage_eval.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments, "-f", "markdown"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode not in (0, 1):
        sys.exit(done.stderr)
    return done.stdout


def section(text: str, title: str) -> str:
    """The part of a page under a heading that begins so, a level deeper."""
    begin = text.index(f"## {title}")
    end = text.find("\n## ", begin + 1)
    return "#" + text[begin : end if end > 0 else None].strip()


def training() -> str:
    """A row per trained checkpoint in the package's folder: what it was trained on, and how its curve ends."""
    lines = [
        "| policy | trained on | steps × batch | processor | last loss | off on episodes held back | gripper right there | file |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for path in sorted(CHECKPOINTS.glob("*.onnx")):
        import onnxruntime

        meta = onnxruntime.InferenceSession(str(path)).get_modelmeta().custom_metadata_map
        about = json.loads(meta["safestage"])
        with path.with_suffix(".csv").open(encoding="utf-8") as file:
            last = list(csv.DictReader(file))[-1]
        recipe = about["recipe"]
        lines.append(
            f"| `learned:{path.stem}` | {about['data']} | {recipe['steps']:,} × {recipe['batch']} | "
            f"{float(last['processor_s']):.0f} s | {float(last['loss']):.3f} | "
            f"{float(last['held_back_mm']):.0f} mm | {100 * float(last['held_back_grip']):.1f} % | "
            f"{path.stat().st_size / 1e6:.1f} MB |"
        )
    return "\n".join(lines)


def page(rows: Path) -> str:
    """The page."""
    tables = printed_by("report", "tables", str(rows), "--intervals", "wilson")
    parts = [
        "# Learned policies on held-out seeds",
        "<!-- Written by benchmarks/learned_page.py; do not edit by hand. -->",
        NOTES.read_text(encoding="utf-8").partition("<!-- after the tables -->")[0].strip(),
        "## Rates", tables.partition("\n")[0], section(tables, "By policy"),
        NOTES.read_text(encoding="utf-8").partition("<!-- after the tables -->")[2].strip(),
        "## Training", training(),
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    Path(sys.argv[2]).write_text(page(Path(sys.argv[1])), encoding="utf-8")
