"""Recorded experience, put to use: trains critics, restores a run's own, or is published again."""

from pga_me_ros.ros.middleware import require_middleware

# Here, before any module of this package imports rclpy, which would end the process.
require_middleware()
