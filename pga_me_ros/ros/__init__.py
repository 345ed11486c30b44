"""The glue between ROS 2 and the core: conversions, quality of service, parameters, start and shutdown."""
