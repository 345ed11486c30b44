"""PGA-MAP-Elites as a ROS 2 node graph.

Grows a repertoire of neural-network gaits that differ in how they use the robot's feet (Nilsson &
Cully 2021, "Policy Gradient Assisted MAP-Elites"), and offers it to other nodes.
"""

__version__ = "0.1.0"
