"""An action has the same bits wherever the numbers are in memory, and in every process."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape, random_parameters

SIZES = [(22, 128, 128, 6), (26, 128, 128, 6), (28, 128, 128, 8), (15, 128, 128, 3), (5, 3)]
CACHE_LINE = 64


def placed(values: np.ndarray, offset: int) -> np.ndarray:
    """Return a copy that begins a number of bytes after the start of a cache line."""
    memory = np.empty(values.nbytes + 2 * CACHE_LINE, np.uint8)
    start = -memory.ctypes.data % CACHE_LINE + offset
    copy = memory[start : start + values.nbytes].view(values.dtype).reshape(values.shape)
    copy[...] = values
    return copy


def action_digest(sizes: tuple[int, ...]) -> str:
    """Return a digest of a controller's actions for a hundred observations."""
    rng = np.random.default_rng(7)
    controller = MlpController(MlpShape(sizes), random_parameters(MlpShape(sizes), rng))
    observations = rng.standard_normal((100, sizes[0]), np.float32)
    return hashlib.sha256(b"".join(controller(o).tobytes() for o in observations)).hexdigest()


@pytest.mark.parametrize("sizes", SIZES, ids=str)
def test_bits_do_not_depend_on_memory_alignment(sizes):
    shape = MlpShape(sizes)
    rng = np.random.default_rng(1)
    parameters = random_parameters(shape, rng)
    observation = rng.standard_normal(sizes[0], np.float32)
    wanted = MlpController(shape, parameters)(observation).tobytes()
    blocks, own_offsets = [], set()
    for offset in range(CACHE_LINE):  # odd ones, too: a message's buffer may begin anywhere
        blocks.append(np.empty(16 + 16 * (offset % 7), np.uint8))  # moves the next allocation
        controller = MlpController(shape, placed(parameters, offset))
        blocks += controller._matrices
        own_offsets |= {m.ctypes.data % CACHE_LINE for m in controller._matrices}
        assert controller(placed(observation, (13 * offset) % CACHE_LINE)).tobytes() == wanted
    assert len(own_offsets) > 1, "all controllers have the same alignment: the test proves nothing"


@pytest.mark.parametrize("sizes", SIZES, ids=str)
def test_rows_of_a_batch_and_strided_views_give_the_same_bits(sizes):
    shape = MlpShape(sizes)
    rng = np.random.default_rng(2)
    batch = np.stack([random_parameters(shape, rng) for _ in range(3)])
    observations = rng.standard_normal((sizes[0], 2), np.float32)
    for row in batch:
        one = MlpController(shape, row)(observations[:, 1])
        other = MlpController(shape, row.copy())(observations[:, 1].copy())
        assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize("threads", ["1", "4"])
def test_bits_are_the_same_in_another_process_with_any_number_of_threads(threads):
    script = "import test_controller_bits as t; print(*(t.action_digest(s) for s in t.SIZES))"
    result = subprocess.run(
        [sys.executable, "-c", script],
        cwd=Path(__file__).parent,
        env=os.environ | {"OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.stdout.split() == [action_digest(sizes) for sizes in SIZES], result.stderr
