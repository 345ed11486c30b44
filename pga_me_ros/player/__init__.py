"""Behaviours to look at: the simulated robot as a model, as messages for ROS tools, and as pictures."""
