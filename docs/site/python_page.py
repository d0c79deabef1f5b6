"""The reference of the Python API: every public name of ``safestage_eval``, by topic."""

from __future__ import annotations

import safestage_eval

TOPICS = {
    "Score": ("score", "Scores", "Finding"),
    "Episodes": ("load", "discover", "Episode", "save", "validate"),
    "Write traces": ("TraceWriter", "Header", "Body", "Geom", "Mesh", "Cavity", "Joint"),
    "Rules": ("load_rules",),
    "Watch a rollout": ("Monitor",),
    "Tables": ("read_outcomes", "aggregate"),
    "Errors": ("InputError", "RuleError", "TraceError"),
}

HEAD = """\
# Python

`import safestage_eval as sse` costs nothing: names are imported when they are first used. [Results in a
notebook](../results.md#in-a-notebook) has examples. This page is written from the docstrings.
"""


def python_page() -> str:
    """A section per topic, with a directive per name."""
    from safestage_eval import _HOMES

    said = {name for names in TOPICS.values() for name in names}
    missing = {*safestage_eval.__all__} - {"__version__"} ^ said
    if missing:
        raise LookupError(
            f"docs/site/python_page.py: TOPICS and __all__ differ in {sorted(missing)}"
        )
    parts = [HEAD]
    for topic, names in TOPICS.items():
        parts.append(f"## {topic}\n")
        for name in names:
            path = f"safestage_eval.{_HOMES[name]}.{name}"
            parts.append(f"::: {path}\n")
    return "\n".join(parts)
