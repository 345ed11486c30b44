"""The simulated robots: the task protocol, the QD locomotion tasks and rollouts; never ROS."""
