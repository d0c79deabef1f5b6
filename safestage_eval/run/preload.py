"""Modules that all workers need: imported once by the process that they are forked from.

That process judges nothing and starts no threads. A worker begins with everything imported, in memory
that all of them share.
"""

import gc

import numpy.ma  # noqa: F401 — this and the next one are lazily imported elsewhere
import pyarrow.compute  # noqa: F401

import safestage_eval.formats.checksum
import safestage_eval.formats.parquet.dataset_reader
import safestage_eval.geometry.edge
import safestage_eval.geometry.footprint
import safestage_eval.metrics
import safestage_eval.relations.facing
import safestage_eval.relations.touch_effect
import safestage_eval.verdicts.judging  # noqa: F401 — all that reads, measures and judges

from . import worker  # noqa: F401

gc.collect()
gc.freeze()  # a collection in a worker would otherwise copy what is shared
