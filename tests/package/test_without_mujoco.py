"""A stored trace is scored where MuJoCo and the simulator cannot be imported."""

import json
import subprocess
import sys

SCORE = """
import importlib.abc
import json
import sys

BANNED = {"mujoco", "simulate", "tabletask"}


class Refuse(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in BANNED:
            raise ImportError(f"{name} is not here")
        return None


sys.meta_path.insert(0, Refuse())
try:
    import mujoco
except ImportError:
    pass
else:
    sys.exit("mujoco was imported after all")

from safestage_eval.formats import load
from safestage_eval.rules.load import load_rules
from safestage_eval.verdicts.judging import judge

result = judge(load(sys.argv[1]), load_rules([sys.argv[2]]))
print(json.dumps({v.rule: v.verdict for v in result.verdicts}))
"""


def test_a_trace_is_scored_without_mujoco(trace, checkout):
    run = subprocess.run(
        [sys.executable, "-c", SCORE, trace, checkout / "rules"],
        cwd=checkout,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    verdicts = json.loads(run.stdout)
    assert {"ISH101", "ETS101", "FSH101"} <= verdicts.keys()
    assert {*verdicts.values()} <= {"pass", "violation", "not_applicable", "inconclusive"}


HEAVY = {
    "fcl",
    "google",
    "mcap",
    "mujoco",
    "pandas",
    "polars",
    "pyarrow",
    "scipy",
    "trimesh",
}


def test_asking_for_help_loads_no_heavy_library(checkout):
    code = "import sys, safestage_eval, safestage_eval.cli; print(*sys.modules)"
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=checkout, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert not HEAVY & {*run.stdout.split()}
