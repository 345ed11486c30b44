"""Pictures of stored gaits, drawn without a display; needs PyBullet and Pillow, and nothing of ROS or torch."""
