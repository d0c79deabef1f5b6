"""One episode under audit."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path
from typing import Any

from safestage_eval.audit import audit_episode as module
from safestage_eval.audit.audit_check import choose
from safestage_eval.audit.subject import Subject
from safestage_eval.formats import discover
from safestage_eval.rules import builtin_names, load_rules

TRACES = Path(__file__).parents[2] / "traces"


def test_an_episode_is_out_of_memory_once_it_is_audited_without_a_collection(monkeypatch) -> None:
    """Its arrays would else stay with a worker, and the next episode ask for as many again."""
    opened = list[weakref.ref[Any]]()

    class Watched(Subject):
        def __init__(self, *args: Any) -> None:
            super().__init__(*args)
            opened.append(weakref.ref(self.episode))

    monkeypatch.setattr(module, "Subject", Watched)
    checks, rules = choose(), load_rules(builtin_names())
    refs = [ref for ref in discover(TRACES) if ref.format == "parquet"][:3]
    gc.collect()
    gc.disable()
    try:
        for ref in refs:
            assert isinstance(module.audit_episode(ref, checks, rules), module.Audited)
    finally:
        gc.enable()
    assert [one() for one in opened] == [None] * len(refs)
