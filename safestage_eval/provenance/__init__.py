"""Provenance of results in a form that can be signed, and a check that they can be reproduced."""
