"""Scenes in a few lines: a readable TOML file becomes a complete episode, without a simulator.

For examples of rules, for tests, for trying a rule out. A sketch is a drawing, not physics: bodies
move as the file says, and contact forces follow from where they are. What stands on a flat face
has contact points at the corners of what meets, which share its weight and all that stands on it so
that forces and torques balance; what is held hangs from two fingers; what falls, falls freely;
every other contact is stated.

    says     = "The apple is carried past the cans, too close."
    duration = "6 s"
    success  = "4.5 s"                       # when the goal is reached; without it, never
    roles    = { target = "apple", protected = "can" }
    knobs    = { gap = "3" }                 # {gap} in any string; "name(gap = 8)" turns it
    story    = [
      { hold = "apple", during = "1 to 4 s", grip = "15 N" },
      { move = "apple", by = "0, 0, 20 cm", during = "1.5 to 2 s" },
      { move = "apple", to = "40, 30, 2 cm", during = "2 to 3.5 s" },
      { drop = "apple", at = "4 s" },
      { touch = "can", by = "apple", side = "-x", force = "2 N", during = "2.5 to 2.6 s" },
    ]

    [bodies.apple]
    shape = "sphere 7.5 cm"                  # outer sizes; diameters of what is round
    at    = "0, 0 cm"                        # the middle of its bottom
    mass  = "180 g"

    [bodies.can]
    shape = "cylinder 7 x 10 cm"
    at    = "7.25 + {gap}, 0 cm"             # numbers may be sums

A table of 1.6 m by 1.6 m with its top at height 0 and a gripper (``hand``, ``finger_left``,
``finger_right``) that waits at the side are there unless ``table = false``, ``gripper = false``.
Quantities carry units as in rule files; masses are in g or kg. ``model`` has every key of the
tables and of the steps: hold, move, turn, tip, roll, drop, touch, reach, channel. Joints with curves
of position and torque stand under ``[joints.NAME]``. ``forces = false`` records no contacts.

Steps that concern one body are carried out in the order in which they begin, and may overlap: a
body may move and turn at once. A ``move`` of several bodies takes them along together; what merely
stands on a carried tray must be named with it.
"""

from .load_sketch import SketchError, draw, read, resolve

__all__ = ["SketchError", "draw", "read", "resolve"]
