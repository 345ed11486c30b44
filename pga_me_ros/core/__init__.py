"""The algorithm: numpy, torch, pybullet and sqlite3, never ROS."""
