"""Rollouts: one recorded whole, many in parallel, campaigns, and their cost beforehand."""
