"""Uses of recorded experience: training critics, restoring a run's experience, publishing it again."""

from pga_me_ros.ros.middleware import require_middleware

# Checked here, before any module of this package imports rclpy, which would end the process.
require_middleware()
