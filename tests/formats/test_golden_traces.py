"""One trace per version of the format stays readable for ever.

A new version adds a folder (``python tests/formats/test_golden_traces.py`` writes the one of this
version); the old ones are never written again.
"""

import sys
from pathlib import Path

import pytest

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[1] / "helpers"), str(Path(__file__).parents[2])]

from recordings import everything

from safestage_eval.episode import SCHEMA_VERSION
from safestage_eval.formats import discover, validate

GOLDEN = Path(__file__).parent / "golden"

HASHES = {
    "1.0": "04994aa5b19f2644279753e2e58a54a929517a4d0c6668025b3cf022d93191aa",
    "1.1": "04994aa5b19f2644279753e2e58a54a929517a4d0c6668025b3cf022d93191aa",
    "1.2": "04994aa5b19f2644279753e2e58a54a929517a4d0c6668025b3cf022d93191aa",
}


@pytest.mark.parametrize("version", HASHES)
@pytest.mark.parametrize("name", ["dataset", "episode.mcap"])
def test_the_trace_of_every_version_is_readable(version, name):
    path = GOLDEN / version / name
    [ref] = discover(path)
    episode = ref.open()
    assert episode.header.schema_version == version
    assert episode.content_hash == ref.content_hash == HASHES[version]
    assert validate(path) == []


def test_this_version_has_its_trace():
    assert SCHEMA_VERSION in HASHES
    assert {folder.name for folder in GOLDEN.iterdir()} == set(HASHES)


def test_recording_the_same_still_gives_the_same_hash():
    assert everything().episode().content_hash == HASHES[SCHEMA_VERSION]


if __name__ == "__main__":
    for target in ("dataset", "episode.mcap"):
        ref = everything().close(GOLDEN / SCHEMA_VERSION / target)
    sys.stdout.write(f"{SCHEMA_VERSION} {ref.content_hash}\n")
