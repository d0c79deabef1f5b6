"""Numbers of things in words."""


def count(number: int, noun: str) -> str:
    """``1 episode``, ``2 episodes``, ``2 bodies``."""
    if number == 1:
        return f"1 {noun}"
    return f"{number} {noun[:-1]}ies" if noun.endswith("dy") else f"{number} {noun}s"
