"""All that hostile inputs are made for."""

from __future__ import annotations

import traceback
import warnings
from random import Random

import calvin_target
import import_target
import rlds_target
import sqlite_target
import states_target
import transforms_target
from mcap_target import Mcap
from outcome import Outcome
from parquet_target import Parquet
from table_target import Tables
from text_target import Bind, Map, Rules
from zip_target import Zipped

TARGETS = {
    "parquet": Parquet,
    "mcap": Mcap,
    "zip": Zipped,
    **import_target.TARGETS,
    **rlds_target.TARGETS,
    **calvin_target.TARGETS,
    **transforms_target.TARGETS,
    **sqlite_target.TARGETS,
    **states_target.TARGETS,
    "rules": Rules,
    "bind": Bind,
    "map": Map,
    "tables": Tables,
}


def attempt(target: object, number: int, seed: int = 0) -> Outcome:
    """One input by its number and the campaign's seed. A warning of NumPy's is an unforeseen error too."""
    rng = Random(f"{seed} {target.name} {number}")
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            outcome = target.run(rng)
        except Exception as error:  # noqa: BLE001 — that is what is looked for
            place = "".join(traceback.format_exception(error)[-3:])
            return Outcome("unforeseen", "", f"{type(error).__name__}: {error} {place}")
    for warning in warned:
        if (
            issubclass(warning.category, RuntimeWarning | SyntaxWarning)
            and "safestage" in warning.filename
        ):
            place = f"{warning.filename}:{warning.lineno}"
            return Outcome(
                "unforeseen",
                outcome.what,
                f"{warning.category.__name__}: {warning.message} {place}",
            )
    return outcome
