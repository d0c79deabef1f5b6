"""Servers of the policies' protocols, to try out clients and campaigns without a model."""
