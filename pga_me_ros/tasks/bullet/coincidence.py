"""Find parts of a robot that always share x and y, so that reading one of them is enough.

The models weld parts to each other and to rails. So several links of a planar robot share x and y bit for bit in every
pose. Reading a link is expensive: the engine computes dozens of numbers for it.
"""

from __future__ import annotations

import random

from pga_me_ros.tasks.bullet.world import World

POSES = 16
"""Number of random poses; parts that don't always share a place differ in at least one of them."""


def places_of(world: World, parts: list[int]) -> list[int]:
    """Return for each part the part to read in its place.

    Leaves the robot in a random pose; the next episode resets it.

    Args:
        world: World with the robot.
        parts: Link indices, -1 for the base.

    Returns:
        For each part: the torso if the two share x and y in every pose, else the first part that shares its x and y in
        every pose, which may be the part itself.
    """
    draws = random.Random(0)
    tracks: list[list[tuple[float, float]]] = [[] for _ in parts]
    for _ in range(POSES):
        world.pose([draws.uniform(-0.5, 0.5) for _ in range(world.joint_count)])
        for track, part in zip(tracks, parts, strict=True):
            track.append(world.place(part))
    torso = tracks[parts.index(world.torso)]
    return [world.torso if track == torso else parts[tracks.index(track)] for track in tracks]
