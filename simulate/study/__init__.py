"""Blind studies: numbered picture sheets of rollouts, and the answers of those who judged them."""
