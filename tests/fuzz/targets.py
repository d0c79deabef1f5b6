"""All that hostile inputs are made for."""

from __future__ import annotations

import traceback
from random import Random

import import_target
import states_target
import transforms_target
from mcap_target import Mcap
from outcome import Outcome
from parquet_target import Parquet
from table_target import Tables
from text_target import Bind, Map, Rules

TARGETS = {
    "parquet": Parquet,
    "mcap": Mcap,
    **import_target.TARGETS,
    **transforms_target.TARGETS,
    **states_target.TARGETS,
    "rules": Rules,
    "bind": Bind,
    "map": Map,
    "tables": Tables,
}


def attempt(target: object, number: int) -> Outcome:
    """One input by its number."""
    rng = Random(f"{target.name} {number}")
    try:
        return target.run(rng)
    except Exception as error:  # noqa: BLE001 — that is what is looked for
        place = "".join(traceback.format_exception(error)[-3:])
        return Outcome("unforeseen", "", f"{type(error).__name__}: {error} {place}")
