"""A cube on a table that is pushed 6 cm along x from 0.5 s to 1 s, and the rule that forbids 2 cm."""

import numpy as np
from scenes import Scene

from safestage_eval.rules import load_rules
from safestage_eval.whatif.judge_again import Again

RULE = """
[ruleset]
format = 1
name = "mine"
version = "1.0.0"
extends = ["defaults"]

[param]
push = "2 cm"

[[rule]]
code = "ETS901"
title = "Do not push it"
roles = { target = "object" }
forbid = { "displacement(target)" = ">= push" }

[[rule]]
code = "ETS902"
title = "It stays high"
roles = { target = "object" }
require = { "height(target)" = ">= 1 cm", "displacement(target)" = "<= 9 cm" }
"""


def path_of(t):
    """m, x of the cube."""
    return np.clip(t - 0.5, 0, 0.5) * 0.12


def pushed(tmp_path, rules=("ETS901", "ETS902"), **header):
    """The episode, opened with the rules."""
    file = tmp_path / "mine.toml"
    file.write_text(RULE, "utf-8")
    scene = Scene(frames=180).fixed("table")
    x = path_of(scene.t)
    scene.box("cube", 0.03, np.column_stack([x, 0 * x, 0 * x + 0.03]))
    scene.box("ball", 0.02, (0.3, 0.2, 0.02))
    episode = scene.episode(roles={"target": ("cube",)}, rules=rules, **header)
    return Again(episode, load_rules([file]))
