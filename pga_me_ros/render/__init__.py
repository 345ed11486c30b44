"""Pictures of stored gaits, drawn without a display. Needs PyBullet and Pillow, but not ROS or torch."""
