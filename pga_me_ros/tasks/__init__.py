"""Simulated robots: the task protocol, the QD locomotion tasks and rollouts. Imports no ROS."""
