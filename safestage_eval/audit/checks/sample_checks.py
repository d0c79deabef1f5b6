"""Checks of what is counted: errors, early ends, uneven and small samples."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import combinations

from safestage_eval._text.plural import count, first_few
from safestage_eval.audit.campaign_groups import groups, ids, label, policies
from safestage_eval.audit.campaign_summary import Campaign
from safestage_eval.audit.finding import Defect
from safestage_eval.doubts.check_registry import check
from safestage_eval.metrics.interval import wilson

POINT = 0.01
"""A difference that is smaller is none that anybody would report."""

FEW = 20
"""Rollouts below which the interval of a rate is given."""


@check(
    "AUD341",
    "warning",
    title="rollouts that ended in an error are in no rate",
    why="The success rate depends on whether errors count as failures, and only one of the two rates is reported.",
    example="12 of 100 rollouts lost to a server that did not answer",
    issue="allenai/vla-evaluation-harness#129",
    cheap=True,
)
def lost_to_errors(campaign: Campaign) -> Iterator[Defect]:
    """Counts rollouts without a recording, and files that cannot be read."""
    lost, known = len(campaign.aborted) + campaign.unreadable, len(campaign.episodes)
    good = sum(one.success is True for one in campaign.episodes)
    if lost and known:
        yield Defect(
            f"{lost} of {lost + known} rollouts ended in an error or cannot be read, and are in no rate: "
            f"SR is {_percent(good, known)} without them, {_percent(good, lost + known)} if they failed.",
            "record them again, or give both rates",
            field="termination",
            episodes=tuple(campaign.aborted),
        )


@check(
    "AUD342",
    "warning",
    title="rollouts that broke off count as failures",
    why="A rollout that ended by an error or was cut off did not fail by itself, but is in N.",
    example="termination = error in 9 of 50 rollouts, all of one policy",
    issue="allenai/vla-evaluation-harness#129",
    cheap=True,
)
def broken_off(campaign: Campaign) -> Iterator[Defect]:
    """Counts recordings with termination error or truncated and no success, policy by policy."""
    for name, some in policies(campaign).items():
        cut = [e for e in some if e.termination in ("error", "truncated") and not e.success]
        if cut:
            good = sum(one.success is True for one in some)
            yield Defect(
                f"{label(name)}: {len(cut)} of {len(some)} rollouts broke off "
                f"({', '.join(sorted({str(one.termination) for one in cut}))}); SR is "
                f"{_percent(good, len(some))} with them, {_percent(good, len(some) - len(cut))} without.",
                "repeat them, or select with --where termination=…, and say which you did",
                field="termination",
                episodes=ids(cut),
            )


@check(
    "AUD343",
    "warning",
    title="policies were tried unequally often",
    why="Rates over different mixes of tasks and seeds differ though the policies may not.",
    example="50 rollouts of one policy on a task, 40 of the other",
    issue="huggingface/lerobot#4152",
    cheap=True,
)
def uneven(campaign: Campaign) -> Iterator[Defect]:
    """Counts the rollouts of each policy and prompt on each task and seed."""
    counts = {
        name: Counter((one.task, one.seed) for one in some)
        for name, some in policies(campaign).items()
    }
    for (one, mine), (other, theirs) in combinations(counts.items(), 2):
        differing = [cell for cell in {*mine, *theirs} if mine[cell] != theirs[cell]]
        if differing:
            task, seed = min(differing, key=str)
            yield Defect(
                f"{label(one)} and {label(other)} differ in {len(differing)} of "
                f"{len({*mine, *theirs})} tasks and seeds: {mine[task, seed]} and {theirs[task, seed]} "
                f"rollouts of {task or '–'}, seed {'–' if seed is None else seed}.",
                "record what is missing, or compare by pairs (safestage compare)",
                field="seed",
            )


@check(
    "AUD344",
    "warning",
    title="policies had different time",
    why="Who has longer succeeds more often; a difference in success may be one in horizons.",
    example="horizon = 30 s for one policy, 60 s for the other",
    cheap=True,
)
def other_horizons(campaign: Campaign) -> Iterator[Defect]:
    """Compares the horizons in the headers of a task's episodes."""
    for task, some in groups(campaign.episodes, lambda one: one.task).items():
        given = groups(
            (e for e in some if e.horizon is not None), lambda e: round(e.horizon or 0, 3)
        )
        if len(given) > 1:
            horizons = "; ".join(
                f"{seconds:g} s for {first_few(sorted({of.policy or '–' for of in episodes}), 3)}"
                for seconds, episodes in sorted(given.items())
            )
            rare = min(given.values(), key=len)
            yield Defect(
                f"task {task or '–'} has {len(given)} horizons: {horizons}.",
                "give every rollout of a task the same time",
                field="horizon",
                episodes=ids(rare),
            )


@check(
    "AUD351",
    "warning",
    title="too few rollouts for the difference",
    why="A difference that the sample cannot show may be chance; the ranking of the policies hangs on it.",
    example="70 % against 60 % success, of 20 rollouts each",
    issue="simpler-env/SimplerEnv#108",
    cheap=True,
)
def underpowered(campaign: Campaign) -> Iterator[Defect]:
    """Compares each observed difference in success with the smallest one that this number of rollouts can detect.

    Detect: with a power of 80 %, by the two-sample test at 5 %, if all rollouts are independent.
    """
    rates = {}
    for name, some in policies(campaign).items():
        decided = [one.success for one in some if one.success is not None]
        rates[name] = sum(decided), len(decided)
    for (one, (good, n)), (other, (well, m)) in combinations(rates.items(), 2):
        if one[1] != other[1] or not n or not m or good * m == well * n:
            continue
        from safestage_eval.metrics.power import smallest_difference

        least = smallest_difference(n, m, (good + well) / (n + m))
        seen = abs(good / n - well / m)
        if seen >= POINT and (least is None or seen < least):
            able = (
                "no difference at all"
                if least is None
                else f"differences from {100 * least:.0f} points on"
            )
            yield Defect(
                f"{label(one)} and {label(other)} differ by {100 * seen:.0f} points in success "
                f"({good}/{n}, {well}/{m}); this number of rollouts shows {able}.",
                "record more rollouts, or compare by pairs (safestage compare says how many would do)",
                field="success",
            )


@check(
    "AUD352",
    "note",
    title="few rollouts",
    why="The true rate may be anywhere in a wide interval.",
    example="3 of 3 successes: the true rate may be 30 %",
    issue="simpler-env/SimplerEnv#108",
    cheap=True,
)
def few(campaign: Campaign) -> Iterator[Defect]:
    """Gives the 95 % interval (Wilson) of the success rate of each policy with fewer than 20 rollouts."""
    for name, some in policies(campaign).items():
        decided = [one.success for one in some if one.success is not None]
        interval = wilson(sum(decided), len(decided))
        if len(decided) < FEW and interval is not None:
            low, high = interval
            yield Defect(
                f"{label(name)}: SR {_percent(sum(decided), len(decided))} of "
                f"{count(len(decided), 'rollout')}; the 95 % "
                f"interval is {100 * low:.0f} to {100 * high:.0f} %.",
                "give the interval with the rate, and record more rollouts",
                field="success",
            )


def _percent(count: int, total: int) -> str:
    return f"{100 * count / total:.1f} %" if total else "–"
