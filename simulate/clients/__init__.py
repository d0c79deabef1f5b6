"""Policies that somebody serves: one file per protocol, each with both ends of the conversation."""
