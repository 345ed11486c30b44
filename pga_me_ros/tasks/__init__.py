"""Simulated robots: the task protocol, the QD locomotion tasks and rollouts. Imports no ROS."""

from pga_me_ros.tasks.quiet_pybullet import silence_banner

silence_banner()
