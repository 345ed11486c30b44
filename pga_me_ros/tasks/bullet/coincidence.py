"""Parts of a robot that are always in one place, so that reading one of them is enough.

The models weld parts to each other and hang them on rails, which gives a planar robot several links that share x and y
to the last bit in every pose. The engine makes dozens of numbers for every link that it is asked about.
"""

from __future__ import annotations

import random

from pga_me_ros.tasks.bullet.world import World

POSES = 16
"""Poses that are looked at: two places that differ at all differ in some of so many."""


def places_of(world: World, parts: list[int]) -> list[int]:
    """Return for each part the part that stands for its place.

    The robot is put into poses drawn at random, which the next episode's beginning undoes.

    Args:
        world: World with the robot.
        parts: Link indices, -1 for the base.

    Returns:
        For each part the torso, if its x and y are those of the torso in every pose, else the first part whose x and y
        are its own in every pose, which may be itself.
    """
    draws = random.Random(0)
    tracks: list[list[tuple[float, float]]] = [[] for _ in parts]
    for _ in range(POSES):
        world.pose([draws.uniform(-0.5, 0.5) for _ in range(world.joint_count)])
        for track, part in zip(tracks, parts, strict=True):
            track.append(world.place(part))
    torso = tracks[parts.index(world.torso)]
    return [world.torso if track == torso else parts[tracks.index(track)] for track in tracks]
