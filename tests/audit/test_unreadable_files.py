"""Files that cannot be read: what the audit counts, and what messages say to do."""

import pytest

from safestage_eval.audit import audit
from safestage_eval.doubts import header_contradictions
from safestage_eval.episode import Episode, Header
from safestage_eval.errors import InputError
from safestage_eval.report.audit_report import headline
from safestage_eval.whatif.flip_table import FlipTable


@pytest.mark.parametrize(("content", "says"), [(b"", "is empty"), (b"hello", "other bytes")])
def test_what_was_not_read_is_not_called_sound(tmp_path, content, says):
    (tmp_path / "a.mcap").write_bytes(content)
    found = audit(tmp_path / "a.mcap")
    assert headline(found) == "0 of 1 episode could be read."
    assert says in found.problems[0].message
    assert "Fix: " in found.problems[0].message


@pytest.mark.parametrize(
    ("spacing", "frame_dt", "cause"),
    [(10, 0.01, "stamps are in milliseconds"), (0.01, 10, "frame_dt is in milliseconds"),
     (0.01, 0.1, "ten times"), (0.1, 0.01, "a tenth"), (0.01, 0.025, "another rate")],
)  # fmt: skip
def test_the_ratio_of_spacing_and_frame_dt_tells_the_mistake(spacing, frame_dt, cause):
    import numpy as np

    header = Header(episode_id="e", physics_dt=0.001, frame_dt=frame_dt)
    [error] = header_contradictions(Episode(header, np.arange(50) * spacing, {}))
    assert cause in error.fix


def test_a_folder_is_no_result_file(tmp_path):
    with pytest.raises(InputError, match=r"a folder.*--what-if all -f parquet -o rows\.parquet"):
        FlipTable(tmp_path)
