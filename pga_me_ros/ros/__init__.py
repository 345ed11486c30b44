"""The glue between ROS 2 and the core: conversions, quality of service, parameters, start and shutdown."""

from pga_me_ros.ros.middleware import require_middleware
from pga_me_ros.ros.own_messages import require_same_messages

# Checked here, before any module of this package imports rclpy, which would end the process, or messages.
require_middleware()
require_same_messages()
