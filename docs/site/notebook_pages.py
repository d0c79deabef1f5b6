"""Notebooks as pages: executed while the site is built, so that what is shown is what comes out."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import nbformat
from nbclient import NotebookClient


def executed(notebook: Path) -> nbformat.NotebookNode:
    """The notebook with its outputs; run in the checkout, an error in a cell is raised."""
    node = nbformat.read(notebook, as_version=4)
    checkout = str(notebook.resolve().parents[2])
    NotebookClient(node, timeout=120, resources={"metadata": {"path": checkout}}).execute()
    return node


def notebook_page(notebook: Path) -> str:
    """Cells and outputs as Markdown."""
    parts = []
    for cell in executed(notebook).cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        parts.extend(_shown(output) for output in cell.outputs)
    link = f"This page is `docs/notebooks/{notebook.name}`, executed when the site was built."
    return "\n\n".join([*parts, link]) + "\n"


def _shown(output: nbformat.NotebookNode) -> str:
    data = output.get("data", {})
    if "image/png" in data:
        base64.b64decode(data["image/png"], validate=True)
        return f'<img alt="What the cell draws" src="data:image/png;base64,{data["image/png"].strip()}">'
    if "text/html" in data:
        html = re.sub(r"\n\s*\n", "\n", data["text/html"])
        return f'<div class="cell-output" markdown="0">\n{html}\n</div>'
    text = data.get("text/plain", output.get("text", ""))
    return f"```\n{text.rstrip()}\n```"
