"""Settings every test shares."""

import os
import sys
from pathlib import Path

import pytest

if "--quick" in sys.argv:  # and in the environment of the processes that run them
    os.environ["SAFESTAGE_FEW_CASES"] = "1"

from browser import browser, tab  # noqa: F401 (fixtures)
from hypothesis import settings
from sampled import tries

import safestage_eval.signals  # noqa: F401 (declares the signals)

os.environ.pop("COLUMNS", None)  # what a parallel run sets is no wish for narrow tables

settings.register_profile("safestage", derandomize=True, deadline=None, max_examples=tries(12, 60))
settings.register_profile("quick", parent=settings.get_profile("safestage"), max_examples=4)
settings.load_profile("safestage")

QUICK = ("episode", "evidence", "signals", "relations", "rules", "verdicts")
"""Rooms that make verdicts; with ``--quick`` their tests are run, and those of the goldens."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--quick",
        action="store_true",
        help="run one case of each test of what a verdict is made of; none that is slow",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Few drawn cases of each law, where all that is wanted is a word at once."""
    if config.getoption("quick"):
        settings.load_profile("quick")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out other rooms, where no path is named."""
    if not config.getoption("quick") or config.args_source.name == "ARGS":
        return None
    inner = collection_path.relative_to(Path(__file__).parent).parts
    if len(inner) > 1 or collection_path.is_dir():
        return (inner[0] not in QUICK) or None
    return (collection_path.name != "test_goldens.py") or None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep the first case of each test that is not slow."""
    if not config.getoption("quick"):
        return
    kept, dropped, met = [], [], set()
    for item in items:
        name = item.nodeid.partition("[")[0]
        new = name not in met and not item.get_closest_marker("slow")
        met.add(name)
        (kept if new else dropped).append(item)
    config.hook.pytest_deselected(items=dropped)
    items[:] = kept
