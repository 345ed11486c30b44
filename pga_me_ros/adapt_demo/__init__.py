"""Adaptation from start to end on one machine: a sound robot, its damage, the trials, the gait that works."""
