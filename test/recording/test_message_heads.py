"""The first fields of messages are read as the middleware wrote them, whatever their alignment."""

from __future__ import annotations

import array

import pytest
from builtin_interfaces.msg import Time
from hypothesis import given, settings
from hypothesis import strategies as st
from pga_me_msgs.msg import Metrics, Transitions
from rclpy.serialization import serialize_message

from pga_me_ros.errors import RequestError
from pga_me_ros.recording.message_heads import EpisodeHead, committed_evaluations, episode_head

words = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12)
int64 = st.integers(-(2**63), 2**63 - 1)
floats = st.floats(allow_nan=False)


@settings(max_examples=30)
@given(words, words, words, int64, int64, floats, st.lists(floats, max_size=5), int64)
def test_the_head_of_an_episode(
    run_id, task, evaluator, generation, evaluation, fitness, descriptor, steps
) -> None:
    msg = Transitions(run_id=run_id, task=task, evaluator=evaluator, generation=generation)
    msg.evaluation, msg.fitness, msg.steps = evaluation, fitness, steps
    msg.descriptor = array.array("d", descriptor)
    msg.states = array.array("f", [1.0, 2.0])
    expected = EpisodeHead(run_id, task, generation, evaluation, fitness, steps)
    assert episode_head(serialize_message(msg)) == expected


@settings(max_examples=30)
@given(words, words, int64)
def test_the_evaluations_of_metrics(run_id, task, evaluations) -> None:
    msg = Metrics(stamp=Time(sec=1, nanosec=2), run_id=run_id, task=task, evaluations=evaluations)
    assert committed_evaluations(serialize_message(msg)) == (run_id, evaluations)


def test_truncated_messages_and_other_bytes_are_refused() -> None:
    data = serialize_message(Transitions(run_id="a", task="b", evaluator="c"))
    head_ends = data.index(b"c\0") + 2 + 4 * 8
    for end in range(head_ends):
        with pytest.raises(RequestError):
            episode_head(data[:end])
    with pytest.raises(RequestError, match="not serialized the way ROS 2 does"):
        episode_head(b"\x07\x07\x07\x07" + data[4:])
