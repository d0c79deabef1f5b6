"""A recorded trace that the tests of the whole package score."""

from pathlib import Path

import pytest
from recordings import falling_cube

from safestage_eval.formats import discover, save

CHECKOUT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def checkout():
    return CHECKOUT


@pytest.fixture
def trace(tmp_path):
    """One episode in a file: the first of traces/, or a falling cube where none are kept."""
    path = tmp_path / "trace.mcap"
    folder = CHECKOUT / "traces"
    recorded = discover([folder]) if folder.is_dir() and any(folder.iterdir()) else []
    if recorded:
        save(recorded[0].open(), path)
    else:
        falling_cube(path=path).close()
    return path
