"""The built-in walking robots, simulated by PyBullet."""
