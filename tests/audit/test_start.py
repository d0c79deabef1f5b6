"""The first frames of an episode: the same contacts whether a table is cut or its pairs are."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from safestage_eval.audit.start import first_frames
from safestage_eval.episode import ContactTable
from safestage_eval.formats import discover

TRACES = Path(__file__).parents[2] / "traces"
COLUMNS = ("frame", "geom1", "position", "force", "force.z")


@pytest.mark.parametrize("count", [1, 7, 100_000])
def test_contacts_of_the_first_frames(count):
    for ref in discover(TRACES)[:3]:
        episode = ref.open(checked=False, whole=True)
        columns = (getattr(episode.contacts, field.name) for field in fields(ContactTable))
        table = ContactTable(*columns)
        early, truth = first_frames(episode, count).contacts, table.where(table.frame < count)
        assert early.pairs == truth.pairs
        np.testing.assert_array_equal(early.force, truth.force)
        for pair in table.pairs:
            for mine, own in zip(
                early.of_pair(pair, *COLUMNS), truth.of_pair(pair, *COLUMNS), strict=True
            ):
                np.testing.assert_array_equal(mine, own)
        assert isinstance(early, ContactTable) and len(early) == len(truth)
