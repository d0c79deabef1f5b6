"""Relations between bodies, frame by frame: support, dependence, containment, grasp."""

from . import vocabulary as vocabulary
