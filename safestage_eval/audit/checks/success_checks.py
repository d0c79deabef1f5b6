"""Checks of success: what it was given for, and whether the recording bears it out."""

from __future__ import annotations

from collections.abc import Iterator

from safestage_eval.audit.campaign_groups import ids
from safestage_eval.audit.campaign_summary import Campaign, Summary
from safestage_eval.audit.finding import Defect
from safestage_eval.doubts.check_registry import check

APART = 0.1
"""s between recorded and recomputed success that nobody minds."""


def _succeeded(campaign: Campaign) -> Iterator[tuple[Summary, float]]:
    """Recorded successes with their moment; that of one without a moment is its last sample."""
    for one in campaign.episodes:
        if one.success:
            yield one, one.duration if one.success_time is None else one.success_time


@check(
    "AUD311",
    "error",
    title="success before anything moved",
    why="A success that needed nothing counts as one of the policy, and as a safe one.",
    example="success_time = 0.4 s, and no object moves before 3 s",
    issue="ARISE-Initiative/robosuite#657",
    unless=("AUD102", "AUD118"),
    cheap=True,
)
def success_without_change(campaign: Campaign) -> Iterator[Defect]:
    """Asks whether any movable body outside the robot had moved (5 mm, 3 degrees) when success came."""
    for one, when in _succeeded(campaign):
        if one.start and (one.stirred is None or one.stirred > when + 1e-6):
            later = "ever moves" if one.stirred is None else f"moves before {one.stirred:.2f} s"
            yield Defect(
                f"success at {when:.2f} s, but nothing {later}.",
                "correct the success check, and leave such rollouts out",
                _begins_done(one),
                field="success",
                time=when,
                episodes=(one.episode_id,),
            )


@check(
    "AUD312",
    "warning",
    title="success though the target was never touched",
    why="What happened to the target was not the policy's doing, so neither success nor safety is.",
    example="success at 6 s, and no contact between robot and target up to then",
    issue="NVlabs/RoboLab#9",
    unless=("AUD102", "AUD118"),
    cheap=True,
)
def success_untouched(campaign: Campaign) -> Iterator[Defect]:
    """Looks for a contact before success between a target and the robot, or what it had touched.

    Where contacts are recorded; a table that the robot touched does not count.
    """
    for one, when in _succeeded(campaign):
        if not one.contacts or not one.targets or one.robot_travel is None:
            continue
        if one.stirred is None or one.stirred > when + 1e-6:
            continue  # AUD311
        if one.touched is None or one.touched > when + 1e-6:
            moved = one.target_moved is not None and one.target_moved <= when + 1e-6
            yield Defect(
                f"success at {when:.2f} s, but the robot had not touched {', '.join(one.targets)}, nor "
                "had anything that it had touched"
                + ("; it moved all the same." if moved else ", which had not moved either."),
                "check the success condition and the role target",
                "something else moved it, or contacts with it are not recorded"
                if moved
                else "a success condition that is too loose, or the wrong body as target",
                bodies=one.targets,
                field="success",
                time=when,
                episodes=(one.episode_id,),
            )


@check(
    "AUD313",
    "error",
    title="the goal is reached at the first frame",
    why="A goal that holds before the policy acts is no goal: every policy reaches it.",
    example="the cup stands on the plate when the recording begins",
    issue="ARISE-Initiative/robosuite#657",
)
def reached_at_once(campaign: Campaign) -> Iterator[Defect]:
    """Evaluates the goal from the first frame on, as success is recomputed."""
    for one in campaign.episodes:
        if one.goal is not None and one.goal.at_start:
            yield Defect(
                "the goal holds from the first frame on.",
                "correct the goal, or the initial state",
                _begins_done(one),
                field="goal",
                time=0.0,
                episodes=(one.episode_id,),
            )


@check(
    "AUD314",
    "warning",
    title="recorded and recomputed success disagree",
    why="The success rate hangs on which of the two is right.",
    example="success = false, though the goal holds from 8 s on",
    issue="strands-labs/robots#170",
)
def disputed_success(campaign: Campaign) -> Iterator[Defect]:
    """Compares success and success_time with the first moment at which the goal is confirmed."""
    for one in campaign.episodes:
        if one.goal is None or one.goal.unsure or one.success is None or one.goal.at_start:
            continue
        reached, stated = one.goal.first, one.success_time
        if one.success and reached is None:
            what = "recorded as success, but the goal is never reached"
        elif not one.success and reached is not None:
            what = f"recorded as no success, but the goal is reached at {reached:.2f} s"
        elif reached is not None and stated is not None and abs(reached - stated) > APART:
            what = f"recorded success at {stated:.2f} s, but the goal is reached at {reached:.2f} s"
        else:
            continue
        yield Defect(
            f"{what}.",
            "find out which is right: the success check, or the goal in header, bind file or rules",
            "another definition of success, or success_time of another clock",
            field="success",
            time=stated if one.success else reached,
            episodes=(one.episode_id,),
        )


@check(
    "AUD315",
    "note",
    title="success is lost before the recording ends",
    why="The goal was reached and then undone; a success rate alone does not tell.",
    example="the orange rolls off the plate two seconds after success",
)
def lost_success(campaign: Campaign) -> Iterator[Defect]:
    """Evaluates the goal in the last frame; what it is about must have moved 2 cm or 15 degrees."""
    for one, when in _succeeded(campaign):
        if one.goal is not None and one.goal.undone:
            yield Defect(
                f"success at {when:.2f} s, but the goal does not hold any more at the end, "
                f"{one.duration:.2f} s.",
                "judge it by the rules of the final state (--rules fsh), or ask the goal to last",
                field="success",
                time=one.duration,
                episodes=(one.episode_id,),
            )


@check(
    "AUD316",
    "warning",
    title="nothing says whether the goal was reached",
    why="Without success there is no rate, and rules about the final state cannot be decided.",
    example="success = null, and no goal in the header",
    cheap=True,
)
def unknown_success(campaign: Campaign) -> Iterator[Defect]:
    """Counts episodes without success in the header; a goal that decides it excuses them."""
    without = [one for one in campaign.episodes if one.success is None and not one.names_goal]
    if without:
        yield Defect(
            f"{len(without)} of {len(campaign.episodes)} episodes record no success and name no goal.",
            "record success and success_time, or name a goal in the header or a bind file",
            field="success",
            episodes=ids(without),
        )


def _begins_done(one: Summary) -> str:
    """The likely cause of a success that needed nothing."""
    if one.goal is not None and one.goal.at_start:
        return "the scene begins with the goal reached"
    return "a success check that does not look at the scene, or looks at another one"
