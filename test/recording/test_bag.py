"""Recordings as files: what other programs read from them, and errors for invalid ones."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from pga_me_msgs.msg import Metrics, Progress, Transitions
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pga_me_ros.errors import PgaError, StorageError
from pga_me_ros.recording.bag import BagWriter, read_bag
from pga_me_ros.recording.definitions import definition, type_name
from pga_me_ros.ros import qos

METRICS = type_name(Metrics)
TOPIC = "/left/repertoire/metrics"


# Only once, because the padding between fields is arbitrary.
MESSAGES = [
    serialize_message(Metrics(run_id="run", task="qd_walker", generation=k)) for k in range(3)
]


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Return a recording of three messages."""
    writer = BagWriter(tmp_path / "bag")
    writer.add(TOPIC, METRICS, qos.LATCHED)
    for message in MESSAGES:
        writer.write(TOPIC, message)
    assert (writer.messages, writer.size) == (3, 3 * len(MESSAGES[0]))
    writer.close()
    return tmp_path / "bag"


def read(bag: Path) -> list[bytes]:
    return [found.data for found in read_bag(bag, [METRICS])]


def test_written_messages_are_read_back(bag: Path) -> None:
    found = list(read_bag(bag, [METRICS, type_name(Transitions)]))
    assert [m.data for m in found] == MESSAGES
    assert {(m.topic, m.type_name) for m in found} == {(TOPIC, METRICS)}
    assert [m.time for m in found] == sorted({m.time for m in found})
    assert list(read_bag(bag, [type_name(Transitions)])) == []


def test_another_reader_decodes_it_from_the_definitions_in_the_file(bag: Path) -> None:
    with Reader(bag) as reader:
        (connection,) = reader.connections
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(connection.msgdef.data, METRICS))
        decoded = [store.deserialize_cdr(data, METRICS) for _, _, data in reader.messages()]
    assert [m.generation for m in decoded] == [0, 1, 2]
    assert {m.task for m in decoded} == {"qd_walker"}
    assert "# cells of the archive" in connection.msgdef.data
    (offered,) = connection.ext.offered_qos_profiles
    assert (offered.durability.name, offered.reliability.name) == ("TRANSIENT_LOCAL", "RELIABLE")
    assert (offered.history.name, offered.depth) == ("KEEP_LAST", 1)


@pytest.mark.parametrize("kind", [Transitions, Metrics, Progress])
def test_the_hash_of_a_type_matches_its_definition(kind: type) -> None:
    of = definition(type_name(kind))
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(of.text, type_name(kind)))
    assert store.hash_rihs01(type_name(kind)) == of.digest


def test_an_existing_folder_is_refused(bag: Path) -> None:
    before = (bag / "bag.mcap").read_bytes()
    with pytest.raises(StorageError, match="exists already; give the recording a folder that does"):
        BagWriter(bag)
    assert (bag / "bag.mcap").read_bytes() == before


def test_a_folder_that_cannot_be_made_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match=r"cannot be written \(Not a directory\)"):
        BagWriter(tmp_path / "file" / "bag")


def not_closed(bag: Path) -> None:
    (bag / "metadata.yaml").unlink()


def no_recording(bag: Path) -> None:
    for file in bag.iterdir():
        file.unlink()


def absent(bag: Path) -> None:
    no_recording(bag)
    bag.rmdir()


def cut_short(bag: Path) -> None:
    file = bag / "bag.mcap"
    file.write_bytes(file.read_bytes()[:-100])


def a_bit_within_a_message(bag: Path) -> None:
    file = bag / "bag.mcap"
    content = bytearray(file.read_bytes())
    content[content.index(MESSAGES[1]) + len(MESSAGES[1]) - 1] ^= 1
    file.write_bytes(content)


def no_yaml(bag: Path) -> None:
    (bag / "metadata.yaml").write_text("{")


def other_fields(bag: Path) -> None:
    digest = definition(METRICS).digest
    for file in bag.iterdir():
        file.write_bytes(file.read_bytes().replace(digest.encode(), b"RIHS01_" + 64 * b"0"))


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (absent, "There is no recording"),
        (no_recording, "is not a recording: it has no metadata.yaml"),
        (not_closed, "was not closed"),
        (cut_short, "is damaged"),
        (a_bit_within_a_message, "messages of /left/repertoire/metrics are not as they were"),
        (no_yaml, "is damaged"),
        (other_fields, "with other fields than the type installed here"),
    ],
)
def test_an_invalid_recording_is_reported_in_one_line(bag: Path, damage, said: str) -> None:
    damage(bag)
    with pytest.raises(StorageError, match=said) as raised:
        read(bag)
    assert "\n" not in str(raised.value)


def test_a_recording_without_our_digests_is_read(bag: Path) -> None:
    # As made by `ros2 bag record`.
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("sha256 of", "of no meaning"))
    assert len(read(bag)) == 3


def test_without_the_library_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(PgaError, match="install it with: pip install rosbags"):
        BagWriter(tmp_path / "bag")


def test_a_type_without_definition_is_reported() -> None:
    with pytest.raises(StorageError, match=r"definition of no_msgs/msg/Nothing cannot be found"):
        definition("no_msgs/msg/Nothing")


def test_definitions_include_all_nested_types() -> None:
    text = definition("nav_msgs/msg/OccupancyGrid").text
    named = {line.removeprefix("MSG: ") for line in text.splitlines() if line.startswith("MSG: ")}
    assert {"std_msgs/Header", "nav_msgs/MapMetaData", "geometry_msgs/Quaternion"} <= named
