"""Pictures and tables from stored runs; needs matplotlib, and nothing of ROS, torch or pybullet."""
