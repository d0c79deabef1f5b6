"""Learned policies: demonstrations as LeRobot datasets, training from them, and acting."""
