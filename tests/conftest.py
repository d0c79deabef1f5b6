"""Settings every test shares."""

import os

from browser import browser, tab  # noqa: F401 (fixtures)
from hypothesis import settings

import safestage_eval.signals  # noqa: F401 (declares the signals)

os.environ.pop("COLUMNS", None)  # what a parallel run sets is no wish for narrow tables

settings.register_profile("safestage", derandomize=True, deadline=None, max_examples=30)
settings.load_profile("safestage")
