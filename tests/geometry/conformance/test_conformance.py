"""Analytic poses: our distances are right in every one."""

from __future__ import annotations

import numpy as np
import pytest
from poses import Pose, asked, poses

from safestage_eval.geometry.surface import ROUND_ERROR


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
            kinds = {geom.kind for body in (pose.a, pose.b) for geom in body.shape.geoms}
            curved = sum(ROUND_ERROR.get(kind, 0.0) for kind in kinds) if "mesh" in kinds else 0.0
            assert upper - lower <= (1e-9 if pose.truth > 1e-5 else 1e-6) + curved
