"""Names and units of the entries of an environment's observations: MuJoCo's own where the layout is known."""

from __future__ import annotations

from typing import Any

_OF_POSITION = {
    0: [("x", "m"), ("y", "m"), ("z", "m"), ("qw", ""), ("qx", ""), ("qy", ""), ("qz", "")],
    1: [("qw", ""), ("qx", ""), ("qy", ""), ("qz", "")],
    2: [("position", "m")],
    3: [("angle", "rad")],
}
"""Entries of a joint's position by MuJoCo's type of joint: free, ball, slide, hinge."""
_OF_SPEED = {
    0: [
        *((f"speed_{axis}", "m/s") for axis in "xyz"),
        *((f"rotation_{axis}", "rad/s") for axis in "xyz"),
    ],
    1: [(f"rotation_{axis}", "rad/s") for axis in "xyz"],
    2: [("speed", "m/s")],
    3: [("rotation", "rad/s")],
}

Entries = list[tuple[str, str]]
"""Name and unit of each entry."""


def observation_entries(env: Any, length: int) -> Entries:
    """Return the entries of an observation; numbered ones where nothing better is known."""
    unwrapped = env.unwrapped
    structure = getattr(unwrapped, "observation_structure", None)
    if structure and hasattr(unwrapped, "model"):
        entries = _mujoco_entries(unwrapped.model, structure)
        if len(entries) == length and len({name for name, _ in entries}) == length:
            return entries
    return [(f"observation_{i}", "") for i in range(length)]


def action_names(env: Any, length: int) -> list[str]:
    """Return a name per action entry: the actuators' or their joints', numbered ones elsewhere."""
    model = getattr(env.unwrapped, "model", None)
    if model is not None and getattr(model, "nu", 0) == length:
        names = [
            model.actuator(i).name or model.joint(int(model.actuator_trnid[i, 0])).name
            for i in range(length)
        ]
        if all(names) and len(set(names)) == length:
            return names
    return [f"action_{i}" for i in range(length)]


def _mujoco_entries(model: Any, structure: dict[str, int]) -> Entries:
    positions, speeds = [], []
    for i in range(model.njnt):
        kind, joint = int(model.jnt_type[i]), model.joint(i).name or f"joint_{i}"
        positions += [(f"{joint}_{name}", unit) for name, unit in _OF_POSITION[kind]]
        speeds += [(f"{joint}_{name}", unit) for name, unit in _OF_SPEED[kind]]
    known = {"qpos": positions[structure.get("skipped_qpos", 0) :], "qvel": speeds}
    entries: Entries = []
    for part, count in structure.items():
        if part.startswith("skipped"):
            continue
        own = known.get(part, [])
        entries += own if len(own) == count else [(f"{part}_{i}", "") for i in range(count)]
    return entries
