"""Processes without ROS: signals, children, standard streams, exit codes."""
