"""The index of rules that ask other benchmarks' questions, read from their files."""

from __future__ import annotations

from safestage_eval.rules import benchmark_names, load_rules

HEAD = """\
# Rules of other benchmarks

Code, question and source of each rule, written from the files in `rules/benchmarks`. A source is a repository at a
commit with a file and a name in it, or a document. [Other benchmarks' questions](../other_benchmarks.md) says how
far they agree with the originals.
"""


def benchmark_page() -> str:
    """A table of rules and costs for each file."""
    parts = [HEAD]
    for name in benchmark_names():
        rules = load_rules([name])
        parts.append(f"## `{name}`\n\n| rule | asks | source |\n|---|---|---|")
        parts.extend(
            f"| `{code}` | {one.title} | {one.source.replace('|', '/')} |"
            for code, one in sorted({**rules.rules, **rules.costs}.items())
        )
        parts.append("")
    return "\n".join(parts)
