#!/bin/sh
# Asks for the gait nearest to a descriptor from a shell, while a run grows or a repertoire is served.
# Takes the `ros2` command of a ROS 2 Jazzy workspace; from wheels alone, see query_behavior.py.
ros2 service call /repertoire/get_behavior pga_me_msgs/srv/GetBehavior "{descriptor: [0.9, 0.1], max_distance: 0.5}"
