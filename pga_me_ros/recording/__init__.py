"""Experience and metrics of a run in rosbag2 folders: written while it is under way, and read again."""
