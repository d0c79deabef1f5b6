"""Counts the words of the documentation as ``wc -w`` does, those written by hand and those generated apart.

python docs/count_words.py          # both totals
python docs/count_words.py --pages  # each page, the longest first
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

WHOLE = re.compile(r"\b[Ww]ritten (by|from) |page is made by ")
"""In a page's first lines: all of it comes from a program."""

PART = re.compile(r"<!-- (?!end)[^>]*-->(.*?)<!-- end", re.DOTALL)
"""A table that a benchmark writes into a page."""

NOTES = ("benchmarks/foreign_notes.md", "benchmarks/learned_notes.md")
"""Written by hand, and put into generated pages."""


def counts() -> dict[str, tuple[int, int]]:
    """Path below the repository → words written by hand, words generated."""
    pages = sorted((ROOT / "docs").rglob("*.md"))
    out = {}
    for path in (ROOT / "README.md", *pages, *(ROOT / name for name in NOTES)):
        text = path.read_text("utf-8")
        words = len(text.split())
        made = len(" ".join(PART.findall(text)).split())
        if WHOLE.search("\n".join(text.splitlines()[:8])):
            made = words
        out[path.relative_to(ROOT).as_posix()] = (words - made, made)
    return out


def main() -> None:
    """Print the totals, or each page."""
    found = counts()
    if "--pages" in sys.argv:
        for path, (own, made) in sorted(found.items(), key=lambda one: -one[1][0]):
            print(f"{own:7,} {made:7,}  {path}")
    own, made = (sum(column) for column in zip(*found.values(), strict=True))
    print(f"{own:,} words written by hand, {made:,} generated")


if __name__ == "__main__":
    main()
