"""Names of what is kept of a rule: what was asked of the trace, and how."""

from __future__ import annotations

from collections.abc import Sequence

from safestage_eval.evidence.declare import Options


def series_name(
    name: str, bodies: Sequence[str], since: str, cap: float, deep: bool, slack: float,
    options: Options,
) -> str:  # fmt: skip
    """Name of a series: what was asked of the trace."""
    return f"signal {name}{tuple(bodies)} {since} {cap} {deep} {slack} {options}"


def state_name(name: str, bodies: Sequence[str], digest: str) -> str:
    """Name of a state's margins; ``digest`` of its definition, empty for a relation."""
    return f"state {name}{tuple(bodies)} {digest}"


def partial_name(name: str, bodies: Sequence[str], options: Options = ()) -> str:
    """Name of what was measured at some frames only."""
    return f"partial {name}{tuple(bodies)}{options or ''}"


def slack_name(name: str, bodies: Sequence[str], frame: int) -> str:
    """Name of what a value may differ by around a frame."""
    return f"{name}{tuple(bodies)} {frame}"
