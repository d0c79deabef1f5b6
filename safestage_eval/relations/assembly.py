"""Bodies that joints connect: parts of the world's furniture, of an object, or of the robot."""

from __future__ import annotations

from collections.abc import Sequence

from safestage_eval.episode import Body


class Assemblies:
    """Where the chain of parents of each body ends; bodies are indices into ``header.bodies``.

    A drawer hangs on its cabinet, and stays in its place. The lid of a jar goes where the jar goes:
    the parts of a free object are borne, carried and lost together, as if their hinge were locked.

    Attributes:
        robot: the moving bodies of the robot.
        fixed: what its joints hold in its place, however it may turn or slide there.
        free: objects, and parts of objects, that nothing but contact holds.
    """

    def __init__(self, bodies: Sequence[Body]) -> None:
        """``bodies``: of one header."""
        index = {body.name: i for i, body in enumerate(bodies)}
        self.robot = {
            i for i, body in enumerate(bodies) if body.kind in ("robot", "gripper") and body.movable
        }
        self._children: dict[int, set[int]] = {}
        for i, body in enumerate(bodies):
            if body.parent in index:
                self._children.setdefault(index[body.parent], set()).add(i)
        self._root = [self._end(bodies, index, i) for i in range(len(bodies))]
        self.fixed = {i for i, root in enumerate(self._root) if root is None}
        self.free = {
            i
            for i, root in enumerate(self._root)
            if root is not None and bodies[i].kind == "object" and bodies[root].kind == "object"
        }
        self._parts: dict[int, set[int]] = {}
        for i, root in enumerate(self._root):
            if root is not None and i not in self.robot:
                self._parts.setdefault(root, set()).add(i)

    def of(self, body: int) -> set[int]:
        """The body and the other parts of the object that it is a part of."""
        root = self._root[body]
        return {body} if root is None else self._parts.get(root, set()) | {body}

    def hanging(self, body: int) -> set[int]:
        """The body and all that is jointed to it, directly or not: a cabinet and its drawers."""
        hanging, todo = {body}, [body]
        while todo:
            more = self._children.get(todo.pop(), set()) - hanging
            hanging |= more
            todo += more
        return hanging

    def on_robot(self, body: int) -> bool:
        """Jointed to the robot, though no part of it: a tool on its flange."""
        return self._root[body] in self.robot and body not in self.robot

    def _end(self, bodies: Sequence[Body], index: dict[str, int], body: int) -> int | None:
        """The last body of the chain that still moves freely, or with the robot; None: none does.

        A chain ends at a body that never moves, at a fixture, or at a parent that is no body of the
        trace (the world); at the robot; or at an object without parent.
        """
        seen: set[int] = set()
        while body not in seen:
            seen.add(body)
            now = bodies[body]
            if not now.movable:
                return None
            if body in self.robot:
                return body
            if now.parent is None:
                return None if now.kind == "fixture" else body
            if now.parent not in index:
                return None
            body = index[now.parent]
        return None
