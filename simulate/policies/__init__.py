"""Policies: references, controls, replays, served ones and a user's own, each by its name."""
