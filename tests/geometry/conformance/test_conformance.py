"""Analytic poses: our distances are right in every one, and the page about the others is current."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from poses import END, PACKAGES, START, Pose, asked, poses, table

PAGE = Path(__file__).resolve().parents[3] / "docs" / "clearance.md"


@pytest.mark.parametrize("pose", poses(), ids=lambda pose: pose.name)
def test_ours_are_right(pose: Pose) -> None:
    for found in asked(pose):
        lower, upper = float(found.lower[0]), float(found.upper[0])
        assert lower <= upper
        if pose.truth is None:
            assert np.isfinite(lower)
            assert upper <= 0
        else:
            assert lower - 1e-9 <= pose.truth <= upper + 1e-9
            assert upper - lower <= (1e-9 if pose.truth > 1e-5 else 1e-6)


def test_the_page_tells_what_the_others_get_wrong() -> None:
    """To the letter for the versions it names; of other versions, only that the poses exist."""
    pytest.importorskip("coal")
    text = PAGE.read_text().split(START)[1].split(END)[0]
    if all(f"{package} {version(package)}" in text for package in PACKAGES.values()):
        assert text.strip() == table(), (
            "run: python tests/geometry/conformance/poses.py docs/clearance.md"
        )
    names = {pose.name for pose in poses()}
    rows = [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("| ")]
    assert set(rows[1:]) <= names
    assert "unit boxes, 3 m apart along y" in rows
