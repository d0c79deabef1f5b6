"""What workers have in common: imported once by the process that they are forked from.

That process judges nothing and starts no threads. A worker begins with everything imported and
every listed kernel loaded, in memory that all of them share.
"""

import gc

import pyarrow.compute  # noqa: F401 — lazily imported elsewhere, as is the next
import scipy.spatial  # noqa: F401

import safestage_eval.verdicts.judging  # noqa: F401 — all that measures and judges
from safestage_eval._process.precompile import load_kernels

from . import worker  # noqa: F401

load_kernels()
gc.collect()
gc.freeze()  # a collection in a worker would otherwise copy what is shared
