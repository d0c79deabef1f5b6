"""Numbers of things in words."""


def count(number: int, noun: str) -> str:
    """``1 episode``, ``2 episodes``."""
    return f"{number} {noun}{'s' * (number != 1)}"
