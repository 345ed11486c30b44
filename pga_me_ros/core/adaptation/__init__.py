"""Intelligent Trial and Error: which behavior of a repertoire a robot tries next when its own no longer works."""
