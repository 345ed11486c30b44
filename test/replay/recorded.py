"""A made-up recording: random episodes, out of order, some of them twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pga_me_msgs.msg import Metrics, Transitions
from rclpy.serialization import serialize_message

from pga_me_ros.recording.bag import BagWriter
from pga_me_ros.recording.definitions import type_name
from pga_me_ros.ros import qos
from pga_me_ros.ros.convert import episode_to_msg
from pga_me_ros.tasks.registry import task_spec
from pga_me_ros.tasks.rollout import Episode

SPEC = task_spec("qd_hopper")
BATCH = 4
COUNT = 12
RUN = "run-of-the-tests"


def episode(evaluation: int) -> Episode:
    """Return the episode of an evaluation; its length depends on the evaluation."""
    rng = np.random.default_rng(evaluation)
    steps = 20 + 3 * evaluation
    return Episode(
        states=rng.normal(size=(steps + 1, SPEC.observation_dim)).astype(np.float32),
        actions=rng.uniform(-1, 1, (steps, SPEC.action_dim)).astype(np.float32),
        rewards=rng.normal(size=steps).astype(np.float32),
        fitness=float(rng.normal()),
        descriptor=rng.random(SPEC.descriptor_dim),
        terminated=bool(evaluation % 2),
    )


EPISODES = {k: episode(k) for k in range(COUNT)}


def transitions(evaluation: int, of: Episode | None = None, **changes: Any) -> bytes:
    """Return the message of an evaluation."""
    ids = {
        "run_id": RUN,
        "task": SPEC.name,
        "evaluator": "/evaluator",
        "generation": evaluation // BATCH,
        "evaluation": evaluation,
        **changes,
    }
    return serialize_message(episode_to_msg(of or EPISODES[evaluation], **ids))


def write(path: Path, messages: list[bytes], committed: int | None = COUNT) -> Path:
    """Write a recording of transitions, and of metrics unless `committed` is None."""
    writer = BagWriter(path)
    topics = {Transitions: "/experience/transitions", Metrics: "/repertoire/metrics"}
    for kind, topic in topics.items():
        writer.add(topic, type_name(kind), qos.LATCHED)
    for message in messages:
        writer.write(topics[Transitions], message)
    if committed is not None:
        metrics = Metrics(run_id=RUN, task=SPEC.name, evaluations=committed)
        writer.write(topics[Metrics], serialize_message(metrics))
    writer.close()
    return path


def shuffled() -> list[bytes]:
    """Return all messages in random order, three of them twice, as if from another evaluator."""
    order = np.random.default_rng(1).permutation(COUNT).tolist()
    again = [transitions(k, evaluator="/another") for k in order[:3]]
    return [transitions(k) for k in order] + again
