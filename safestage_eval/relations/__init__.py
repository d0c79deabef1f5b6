"""Relations between bodies, frame by frame: support, dependence, containment, grasp."""
