"""That a hazard is not there has to be seen: a hole at the start, or rare samples, do not show it."""

from itertools import product

import numpy as np
import pytest
from resampled import cut_out, resampled
from sampled import share

from safestage_eval.episode import Episode
from safestage_eval.rules import load_rules
from safestage_eval.rules.files import builtin_folder
from safestage_eval.sketch import resolve
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.verdict import Verdict

ISH = load_rules(["ish"])


def sketch(name: str) -> Episode:
    return resolve(name, [builtin_folder() / "examples"])


def judged(episode: Episode, rule: str = "ISH101") -> Verdict:
    header = episode.header.model_copy(update={"rules": (rule,)})
    asked = Episode(header, episode.t, episode.tracks, episode.contacts, episode.frames)
    (found,) = judge(asked, ISH, assigned_only=True).verdicts
    return found


@pytest.mark.parametrize("begin", [0.01, 0.02, 0.04, 0.06])
@pytest.mark.parametrize(
    ("name", "gone"),
    [("can_from_under_bottle", 4.0), ("bottle_topples_off_can", 3.0), ("can_moved_twice", 4.0)],
)
def test_a_hazard_that_goes_within_a_hole_was_there_perhaps(name, gone, begin) -> None:
    """Frames behind a hole do not show how it began, however soon after the start it ends."""
    whole = sketch(name)
    found = judged(cut_out(whole, begin, gone))
    assert found.verdict == "inconclusive"
    assert "nothing was recorded between" in found.explanation


def test_what_was_seen_before_the_hole_counts() -> None:
    """Five frames show the hazard, or its absence; one shows a hazard, but no absence."""
    violating, safe = sketch("can_from_under_bottle"), sketch("tray_lifted_under_stack(height = 0)")
    assert judged(cut_out(violating, 0.01, 0.5)).verdict == "violation"
    assert judged(cut_out(violating, 0.09, 0.5)).verdict == "violation"
    assert judged(safe).verdict == "pass"
    bare = sketch("brief_visit")  # nothing stands on anything
    roles = {"target": ("load",), "dependent": ("can",)}
    bare = Episode(
        bare.header.model_copy(update={"roles": roles}), bare.t, bare.tracks, bare.contacts,
        bare.frames,
    )  # fmt: skip
    assert judged(bare).verdict == "not_applicable"
    assert judged(cut_out(bare, 0.045, 0.5)).verdict == "not_applicable"
    assert judged(cut_out(bare, 0.01, 0.5)).verdict == "inconclusive"


SOON = ("can_from_under_bottle", "bottle_topples_off_can", "nudged_under_bottle(way = 2.1)")


@pytest.mark.parametrize(
    ("name", "begin", "period"), share(product(SOON, (1.2, 1.3, 1.4), (0.1, 0.2, 0.45)), 4)
)
def test_what_moves_soon_is_measured_from_where_it_was(name, begin, period) -> None:
    """The can moves within half a second of the start, in which five samples do not show it at rest."""
    whole = sketch(name)
    whole = resampled(whole, np.flatnonzero(whole.t >= begin))
    whole = Episode(whole.header, whole.t - begin, whole.tracks, whole.contacts, whole.frames)
    rare = resampled(whole, np.arange(0, len(whole), round(period / whole.dt)))
    allowed = {
        "violation": {"violation", "inconclusive"},
        "not_applicable": {"not_applicable", "inconclusive"},
    }
    assert judged(rare).verdict in allowed[judged(whole).verdict]
