"""Settings every test shares."""

from hypothesis import settings

settings.register_profile("safestage", derandomize=True, deadline=None, max_examples=30)
settings.load_profile("safestage")
