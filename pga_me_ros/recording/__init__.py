"""Experience and metrics of a run in rosbag2 folders: written during the run, and read back."""
