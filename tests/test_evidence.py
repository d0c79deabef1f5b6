"""Less evidence never makes an episode safe: a sample of benchmarks/evidence.py, new each day."""

import sys
from datetime import UTC, datetime
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HERE / "benchmarks"))

import evidence  # noqa: E402

SEED = datetime.now(UTC).toordinal()
MEASURED = [
    "pose_nan", "all_nan", "unseen", "contact_nan", "bad_normals", "no_forces", "robot_nan",
    "header_unknown", "body_unknown", "body_removed", "early_end", "velocities_gone",
    "contacts_gone", "joints_untold",
]  # fmt: skip
"""Kinds of edits of what was measured."""
SHORTER = ["hole", "thinned", "late_start", "role_unbound", "role_misspelt"]
"""Those of the clock and of roles."""


def told(found):
    return [f"--seed {SEED} --only {o.number}: {o}" for o in found if o.breaches]


def test_what_was_not_measured_satisfies_nothing():
    found = evidence.campaign([str(HERE / "traces")], SEED, 240, kinds=MEASURED)
    assert sum(bool(o.became) for o in found) > 150
    assert not told(found)


def test_a_shorter_clock_and_missing_roles_satisfy_nothing():
    assert not told(evidence.campaign([str(HERE / "traces")], SEED, 80, kinds=SHORTER))


def test_the_law_is_broken_by_what_breaks_it():
    assert evidence.forbidden("violation", "pass")
    assert evidence.forbidden("violation", "not_applicable")
    assert evidence.forbidden("pass", "violation")
    assert not evidence.forbidden("violation", "inconclusive")
    assert not evidence.forbidden("pass", "not_applicable")


def test_an_edit_is_the_same_again():
    one, again = (evidence.attempt((str(HERE / "traces"),), 5, 3) for _ in range(2))
    assert one == again
