"""Persistence: from a margin per frame to states, events and scopes in time. No names, no units."""
