"""Recordings in the layouts of others, imported: sound ones have no finding that is an error."""

import pytest
from exports import map_text, write_lerobot, write_maniskill, write_robolab
from seeded_defects import BIN, CANS, GLASSES, SHELF, sound

from safestage_eval.audit import audit
from safestage_eval.importers import Settings, import_all, load_map

TRUE = {"AUD125", "AUD135", "AUD136", "AUD137", "AUD109", "AUD110", "AUD157"}
"""Codes of warnings that are true of what these layouts lose: shapes, masses, fingers, the tail."""


def imported(episode, layout, folder):
    """The folder of the imported episode."""
    text = map_text(episode, success=layout == "lerobot")
    source = folder / "theirs"
    if layout == "robolab":
        path = write_robolab(source, [episode], boxes=False)
    elif layout == "maniskill":
        path = write_maniskill(source, episode)
    else:
        path, columns = write_lerobot(source, [episode], "v3.0")
        text += columns
    file = folder / "map.toml"
    file.write_text(text)
    outcome = import_all(path, folder / "data", Settings(map=load_map(file)))
    assert not outcome.failed
    return folder / "data"


@pytest.mark.parametrize(
    ("name", "layout"),
    [(CANS[0], "robolab"), (GLASSES[0], "maniskill"), (BIN[0], "lerobot"), (SHELF[0], "robolab")],
)
def test_what_others_recorded_soundly_has_no_error(tmp_path, name, layout):
    found = audit(imported(sound(name), layout, tmp_path), select=["AUD1", "AUD2"])
    assert found.episodes == 1
    assert not [f for f in found.findings if f.severity == "error"]
    assert {f.code for f in found.findings if f.severity == "warning"} <= TRUE, found.findings
