"""Checkpoint files: what is read back, and what is refused."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from pga_me_ros.core.storage.checkpoint import (
    checkpoint_shapes,
    load_checkpoint,
    save_checkpoint,
)
from pga_me_ros.errors import StorageError

ARRAYS = {
    "weights": np.arange(21, dtype=np.float32).reshape(3, 7) / 3,
    "steps": np.float32(7.0) * np.ones(()),
    "none": np.empty((0, 4), np.float32),
    "flags": np.array([True, False, True]),
    "count": np.array([2**60], np.int64),
}
META = {"generation": 12, "task": "qd_ant", "versions": {"torch": "2.13"}}


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "critic.ckpt"
    save_checkpoint(path, ARRAYS, META)
    return path


def test_arrays_and_metadata_are_read_back_bit_for_bit(saved):
    arrays, meta = load_checkpoint(saved)
    assert meta == META
    assert list(arrays) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert arrays[name].dtype == array.dtype
        assert arrays[name].shape == array.shape
        assert arrays[name].tobytes() == array.tobytes()


def test_loaded_arrays_can_be_written_to(saved):
    arrays, _ = load_checkpoint(saved)
    arrays["weights"] += 1
    np.testing.assert_array_equal(arrays["weights"], ARRAYS["weights"] + 1)


def test_equal_content_makes_equal_files(saved, tmp_path):
    save_checkpoint(tmp_path / "again", ARRAYS, META)
    assert (tmp_path / "again").read_bytes() == saved.read_bytes()


def test_an_array_that_is_not_contiguous_is_stored_by_value(tmp_path):
    save_checkpoint(tmp_path / "f", {"a": ARRAYS["weights"].T[::2]}, {})
    np.testing.assert_array_equal(load_checkpoint(tmp_path / "f")[0]["a"], ARRAYS["weights"].T[::2])


def test_every_shorter_file_is_refused(saved):
    content = saved.read_bytes()
    for length in range(len(content)):
        saved.write_bytes(content[:length])
        with pytest.raises(StorageError, match=r"critic\.ckpt"):
            load_checkpoint(saved)


def test_every_flipped_byte_is_refused(saved):
    content = saved.read_bytes()
    for position in range(len(content)):
        damaged = bytearray(content)
        damaged[position] ^= 1 << position % 8
        saved.write_bytes(damaged)
        with pytest.raises(StorageError, match=r"critic\.ckpt"):
            load_checkpoint(saved)


def test_a_file_of_another_version_is_distinguished_from_a_damaged_one(saved):
    content = bytearray(saved.read_bytes())
    content[7:8] = b"2"
    saved.write_bytes(content)
    for read in (load_checkpoint, checkpoint_shapes):
        with pytest.raises(StorageError, match=r"critic\.ckpt has layout version '2'.* reads '1'"):
            read(saved)


def test_shapes_are_read_from_the_beginning_of_the_file(saved):
    content = saved.read_bytes()
    assert checkpoint_shapes(saved) == {name: a.shape for name, a in ARRAYS.items()}
    for length in range(40):
        saved.write_bytes(content[:length])
        with pytest.raises(StorageError, match=r"critic\.ckpt"):
            checkpoint_shapes(saved)


def test_a_pickle_is_refused_and_not_run(tmp_path):
    path = tmp_path / "foreign"
    path.write_bytes(pickle.dumps({"weights": [1.0]}))
    with pytest.raises(StorageError, match="not a checkpoint of this program"):
        load_checkpoint(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(StorageError, match=r"absent\.ckpt: No such file"):
        load_checkpoint(tmp_path / "absent.ckpt")


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(StorageError, match=r"absent.*No such file"):
        save_checkpoint(tmp_path / "absent" / "critic.ckpt", ARRAYS, META)


def test_a_failed_write_leaves_the_old_checkpoint(saved):
    with pytest.raises(StorageError, match="objects"):
        save_checkpoint(saved, {"objects": np.array([object()])}, META)
    assert load_checkpoint(saved)[1] == META


def test_metadata_that_json_cannot_hold_is_refused(tmp_path):
    with pytest.raises(StorageError, match="not JSON"):
        save_checkpoint(tmp_path / "f", {}, {"weights": np.zeros(3)})


def test_no_temporary_file_is_left(saved):
    assert [p.name for p in saved.parent.iterdir()] == ["critic.ckpt"]
