"""Evaluates elites again from other initial poses, in this process's children; needs nothing of ROS."""
