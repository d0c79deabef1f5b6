"""Where sources are read that the tests import."""

import pytest

from safestage_eval.importers import import_source
from safestage_eval.importers.read_source import Here


@pytest.fixture(autouse=True)
def in_this_process(request, monkeypatch):
    """Unless several are asked for; ``test_read_source`` tries what processes are there for."""
    if request.module.__name__ != "test_read_source":
        apart = import_source.Apart
        monkeypatch.setattr(
            import_source,
            "Apart",
            lambda target, limits, jobs: Here(target) if jobs == 1 else apart(target, limits, jobs),
        )
