"""What is judged in a few frames of an episode is measured there alone, and nobody can tell."""

from pathlib import Path

import pytest

from safestage_eval.evidence.measure import Signals
from safestage_eval.formats import discover
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import brief, judge

TRACES = Path(__file__).parents[2] / "traces"


@pytest.mark.parametrize("sway", ["10 deg", "0.001 deg"])
def test_verdicts_are_those_of_whole_series(sway: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rules, alone = load_rules(["fsh"]), []
    plain = Signals.stretch

    def counted(*asked):
        found = plain(*asked)
        alone.append(found is not None)
        return found

    monkeypatch.setattr(Signals, "stretch", counted)
    values = {"sway": sway, "sink_in": "0.0001 mm"} if sway != "10 deg" else {}
    for ref in discover([TRACES]):
        if ref.fields["stage"] != "FSH":
            continue
        del alone[:]
        found = judge(ref.open(), rules, overrides=values)
        assert any(alone)
        with monkeypatch.context() as patched:
            patched.setattr(brief, "SHARE", 10**9)
            assert judge(ref.open(), rules, overrides=values) == found
