"""Behaviors on a robot's joints: from sensor messages to observations, and from actions to commands that are safe."""
