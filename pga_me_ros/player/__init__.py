"""Behaviors to play: the simulated robot as a model and as messages for ROS tools."""
