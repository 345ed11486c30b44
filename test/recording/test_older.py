"""Recordings of older versions: their messages are read as those of this one, without what they did not know of."""

from __future__ import annotations

from pathlib import Path

import pytest
from pga_me_msgs.msg import Transitions
from rclpy.serialization import deserialize_message

from pga_me_ros.errors import StorageError
from pga_me_ros.recording import bag as bags
from pga_me_ros.recording.bag import BagWriter, read_bag
from pga_me_ros.recording.definitions import MessageDefinition, definition, type_name
from pga_me_ros.recording.message_heads import episode_head
from pga_me_ros.recording.older import SEQUENCES_SINCE
from pga_me_ros.ros import qos

TRANSITIONS = type_name(Transitions)
(DIGEST,) = SEQUENCES_SINCE[TRANSITIONS]
EPISODE = bytes.fromhex(
    "00010000040000006f6c64000a00000071645f686f70706572006433030000002f65003701000000000000000500000000000000000000000000"
    "f83f0100000084005a40000000000000d03f010000000000000002000000000000000100000000000000040000000000803f0000004000004040"
    "00008040010000000000003f010000000000c03f01"
)
"""An episode of one step, as a version without intended descriptors serialized it."""


def recorded(path: Path, digest: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a recording of the episode by a version whose definition had a digest."""
    with monkeypatch.context() as patch:
        older = MessageDefinition(definition(TRANSITIONS).text, digest)
        patch.setattr(bags, "definition", lambda _: older)
        writer = BagWriter(path)
        writer.add("/experience/transitions", TRANSITIONS, qos.LATCHED)
        writer.write("/experience/transitions", EPISODE)
        writer.close()
    return path


def test_an_episode_without_intended_descriptor_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = recorded(tmp_path / "bag", DIGEST, monkeypatch)
    (message,) = read_bag(bag, [TRANSITIONS])
    episode = deserialize_message(message.data, Transitions)
    assert (episode.run_id, episode.evaluation, episode.terminated) == ("old", 5, True)
    assert list(episode.states) == [1.0, 2.0, 3.0, 4.0]
    assert (list(episode.descriptor), list(episode.intended_descriptor)) == ([0.25], [])
    assert episode_head(message.data).steps == 1


def test_the_version_before_is_another_than_this_one() -> None:
    assert definition(TRANSITIONS).digest != DIGEST


def test_an_unknown_version_is_still_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = recorded(tmp_path / "bag", DIGEST[:-1] + "0", monkeypatch)
    with pytest.raises(StorageError, match="with other fields than the type installed here"):
        list(read_bag(bag, [TRANSITIONS]))
