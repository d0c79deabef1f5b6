"""The body whose frame is the hand's."""

from __future__ import annotations

from safestage_eval.episode import Episode


def gripper_frame(episode: Episode) -> str | None:
    """The body that carries the tool centre point, or the nearest that bears both fingers.

    Else the only body of the gripper, if there is just one.
    """
    bodies = episode.bodies
    tools = [body.name for body in bodies.values() if body.tcp is not None]
    if tools:
        return tools[0] if len(tools) == 1 else None
    lines = [_line(episode, body.name) for body in bodies.values() if body.finger is not None]
    if not lines:
        grippers = [b.name for b in bodies.values() if b.kind == "gripper" and b.movable]
        return grippers[0] if len(grippers) == 1 else None
    return next((name for name in lines[0] if all(name in line for line in lines)), None)


def _line(episode: Episode, name: str) -> list[str]:
    """A body and all that it hangs on, from near to far."""
    line: list[str] = []
    following: str | None = name
    while following in episode.bodies and following not in line:
        line.append(following)
        following = episode.bodies[following].parent
    return line
