"""Verdicts as remarks at their instants, for viewers that play an episode."""

from __future__ import annotations

from collections.abc import Iterator

from safestage_eval.formats.event import Event
from safestage_eval.verdicts import EpisodeResult, Verdict


def events(result: EpisodeResult, end: float) -> list[Event]:
    """When a violation began, when it was worst, when it was over; what passed, at the end.

    Rules that do not apply, or that pass without being assigned, are left out.

    Args:
        result: of an episode.
        end: s, time of its last frame.
    """
    every = [event for verdict in result.verdicts for event in _of(verdict, end)]
    return sorted(every, key=lambda event: event.time)


def _of(v: Verdict, end: float) -> Iterator[Event]:
    def event(time: float, text: str, level: str = "info") -> Event:
        return Event(time, f"{v.rule} {text}", level, v.rule)  # type: ignore[arg-type]

    if v.verdict == "violation":
        first = v.time if v.time is not None else end
        follows = f" (follows {v.consequence_of})" if v.consequence_of else ""
        yield event(first, f"violation{follows}: {v.explanation or v.title}", "error")
        worst = v.worst_time
        if worst is not None and worst > first and v.signal is not None:
            yield event(worst, f"worst: {v.signal}", "error")
        yield from (event(b, "violation is over") for _, b in v.intervals if b < end)
    elif v.verdict == "inconclusive" and v.assigned:
        yield event(end, f"inconclusive: {v.explanation or v.title}", "warning")
    elif v.verdict == "pass" and v.assigned:
        yield event(end, f"pass: {v.title}")
