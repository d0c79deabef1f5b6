"""One episode in plain sentences: what it is, and why its verdicts are what they are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from safestage_eval._text.plural import count
from safestage_eval._text.printable import printable
from safestage_eval.episode import Episode
from safestage_eval.formats.event import Event
from safestage_eval.units import format_quantity
from safestage_eval.verdicts import EpisodeResult, Verdict

from .results_text import by_importance, goal_of

MOST = 4
"""Intervals that are listed one by one."""


def explain(result: EpisodeResult, *, everything: bool = False) -> str:
    """Success, then one sentence per violation and assigned rule; ``everything``: of all rules, with all that is known."""
    lines = [f"{result.episode_id}: {goal_of(result)}."]
    lines += [f"  note: {note}" for note in result.notes]
    if result.not_loaded:
        lines.append(f"  not loaded, so not judged: {', '.join(result.not_loaded)}")
    verdicts = [
        v
        for v in by_importance(result.verdicts)
        if everything or v.assigned or v.verdict == "violation"
    ]
    for v in verdicts:
        if v.consequence_of is None:
            lines += _verdict(v, everything=everything)
            for other in verdicts:
                if other.consequence_of == v.rule:
                    lines += ["  " + line for line in _verdict(other, everything=everything)]
    for cost in result.costs:
        if cost.budget is None:
            lines.append(f"  {cost.rule} (no budget, no verdict): {cost.title}.")
            lines += [f"    {cost.as_verdict.explanation}"] if cost.value is not None else []
            lines += [f"    note: {note}" for note in cost.notes]
    return "\n".join(map(printable, lines)) + "\n"


def _verdict(v: Verdict, *, everything: bool) -> list[str]:
    head = f"  {v.rule} {v.verdict.replace('_', ' ')}"
    if not v.assigned:
        head += f" (follows {v.consequence_of})" if v.consequence_of else " (not assigned)"
    lines = [f"{head}: {v.title}."]
    if v.explanation:
        lines.append(f"    {v.explanation}")
    if not everything and not (v.assigned and v.verdict == "violation"):
        return lines
    if v.value is not None and v.limit is not None and v.dimension is not None:
        facts = [f"value {_number(v.value, v)}", f"limit {_number(v.limit, v)}"]
        if v.margin is not None:
            facts.append(f"margin {_number(v.margin, v)}")
        if v.worst_time is not None and v.dimension != "time":
            facts.append(f"at {v.worst_time:.2f} s")
        lines.append(f"    {v.signal}: {', '.join(facts)}")
    if v.verdict == "violation":
        since = "" if v.time is None else f"first at {v.time:.2f} s, "
        lines.append(
            f"    {since}{v.exposure_time:.2f} s in all, {v.violated_instances} of "
            f"{count(v.instances, 'instance')}" + _repeated(v)
        )
        lines.append(f"    in violation: {_stretches(v.intervals)}")
    if everything and v.raw_intervals and v.raw_intervals != v.intervals:
        lines.append(f"    before filtering: {_stretches(v.raw_intervals)}")
    if everything and v.sources:
        lines.append(f"    bound: {'; '.join(v.sources)}")
    return lines + [f"    note: {note}" for note in v.notes if everything]


def _repeated(v: Verdict) -> str:
    """``, severity critical, 3 times (serious: 2, critical: 1)``; nothing of a single violation."""
    said = f", severity {v.severity}" if v.severity else ""
    if v.breaches < 2:
        return said
    levels = ", ".join(f"{level}: {count}" for level, count in v.breaches_by_level)
    return f"{said}, {v.breaches} times" + (f" ({levels})" if levels else "")


def _stretches(intervals: Sequence[tuple[float, float]]) -> str:
    """``2.50 s to 3.00 s, 3.12 s to 3.50 s``; of many, the first few and the number of the others."""
    shown = [f"{begin:.2f} s to {end:.2f} s" for begin, end in intervals[:MOST]]
    more = len(intervals) - len(shown)
    return ", ".join(shown) + (f", and {more} more" if more else "")


def _number(value: float, v: Verdict) -> str:
    return format_quantity(value, v.dimension or "")


def describe(episode: Episode) -> str:
    """Header, bodies with their roles, and a timeline."""
    header = episode.header
    roles: dict[str, list[str]] = {}
    for role, players in header.roles.items():
        for player in players:
            roles.setdefault(player, []).append(role)
    forces = {"none": "no forces"}.get(header.force_source, f"forces {header.force_source}")
    duration = float(episode.t[-1] - episode.t[0])
    lines = [
        f"{header.episode_id}",
        f"  task       {header.task or '–'}  ({header.stage or '–'}, {header.family or '–'})",
        f"  policy     {header.policy or '–'}, prompt {header.prompt or '–'}, "
        f"seed {_or_dash(header.seed)}, rollout {_or_dash(header.rollout)}",
        f"  instruction {header.instruction or '–'}",
        f"  goal       {header.goal if isinstance(header.goal, str) else '(in the header)'}, "
        f"assigned rules {', '.join(header.rules) or '–'}",
        f"  frames     {len(episode)} in {duration:.2f} s, {1 / episode.dt:.0f} Hz "
        f"(physics {1 / header.physics_dt:.0f} Hz)",
        f"  contacts   {len(episode.contacts)}, {forces}",
        f"  source     {header.source.simulator or '–'} {header.source.simulator_version or ''}, "
        f"{header.source.recorder or '–'} {header.source.recorder_version or ''}",
        f"  hash       {episode.content_hash}",
        "  bodies",
    ]
    for body in header.bodies:
        if body.kind in ("robot", "gripper"):
            continue
        mass = f"{body.mass:.3f} kg" if body.mass else "–"
        part = ", ".join(roles.get(body.name, [])) or "–"
        kind = body.kind if body.movable else f"{body.kind}, fixed"
        lines.append(
            f"    {body.name:<18} {kind:<16} {mass:>10}  {count(len(body.geoms), 'shape'):>9}  {part}"
        )
    robot = sum(body.kind in ("robot", "gripper") for body in header.bodies)
    lines.append(f"    and {count(robot, 'body')} of the robot")
    lines.append("  timeline")
    lines += [f"    {time:7.2f} s  {what}" for time, what in _timeline(episode)]
    lines += [f"  note: {note}" for note in header.notes]
    lines += [f"  {remark}" for remark in header.source.account]
    return "\n".join(map(printable, lines)) + "\n"


def _timeline(episode: Episode) -> list[tuple[float, str]]:
    """Start, first touch of each role's body by the gripper, success, end."""
    header, t = episode.header, episode.t
    events = [(float(t[0]), "start"), (float(t[-1]), f"end ({header.termination or 'unknown'})")]
    if header.success_time is not None:
        events.append((header.success_time, "success"))
    contacts, index = episode.contacts, episode.body_index
    gripper = frozenset(index[b.name] for b in header.bodies if b.kind == "gripper")
    for name in dict.fromkeys(p for players in header.roles.values() for p in players):
        touched = contacts.frame[contacts.between(gripper, frozenset({index[name]}))]
        if len(touched):
            events.append((float(t[touched.min()]), f"gripper first touches {name}"))
            events.append((float(t[touched.max()]), f"gripper last touches {name}"))
        height = episode.track(name).position[:, 2]
        if float(np.ptp(height)) > 0.01:
            events.append((float(t[int(np.argmax(height))]), f"{name} at its highest"))
    return sorted(events)


def _or_dash(value: int | None) -> str:
    return "–" if value is None else str(value)


def events(result: EpisodeResult, end: float) -> list[Event]:
    """When a violation began, when it was worst, when it was over; what passed, at the end.

    Rules that do not apply, or that pass without being assigned, are left out.

    Args:
        result: of an episode.
        end: s, time of its last frame.
    """
    every = [event for verdict in result.verdicts for event in _events_of(verdict, end)]
    return sorted(every, key=lambda event: event.time)


def _events_of(v: Verdict, end: float) -> Iterator[Event]:
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
