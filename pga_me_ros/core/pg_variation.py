"""Policy gradient variation, VARIATION_PG of Alg. 5 (Nilsson & Cully 2021)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from pga_me_ros.core.errors import NetworkError
from pga_me_ros.core.flat_adam import flat_adam, reset_adam
from pga_me_ros.core.helping_threads import GoesOn, do_with_helpers
from pga_me_ros.core.policy import MlpShape, Vector
from pga_me_ros.core.torch_device import choose_device, torch_threads
from pga_me_ros.core.value_ascent import climb_on, value_ascent

Float32Array = NDArray[np.float32]


def pg_variation(
    parents: Float32Array,
    critic: Vector,
    states: Float32Array,
    learning_rate: float,
    controller_shape: MlpShape,
    critic_shape: MlpShape,
    *,
    threads: int = 1,
    workers: int = 1,
    device: str = "cpu",
) -> Float32Array:
    """Return one offspring per parent: n_grad Adam steps up the mean of Q1(s, pi(s)) (Eq. 1).

    On a CPU an offspring depends on nothing but its parent, the critic, its states and `threads`:
    it is bit for bit the same alone, in any batch, and with any number of workers.

    Args:
        parents: (n, P) float32 controllers.
        critic: (P_critic,) float32, Q1; it stays as it is.
        states: (n_grad, N, obs_dim) float32 batches shared by all offspring, or (n, n_grad, N,
            obs_dim) with own batches for each (setting pg_batches).
        learning_rate: Adam's; each offspring starts with fresh moments.
        controller_shape: Layers of the controllers.
        critic_shape: Layers of the critic.
        threads: Threads of each matrix product (setting torch_threads); the last bits depend on it.
        workers: Offspring computed at a time at most, each on a thread of its own where a core is free; a matter of
            speed alone. Not used on a GPU, which computes all offspring at once.
        device: 'cpu', 'auto' (a GPU if torch finds one), or another torch device.

    Returns:
        (n, P) float32.

    Raises:
        NetworkError: Parents, critic and states do not fit each other or the layers.
        SettingsError: The device cannot be used here.
    """
    problem = _Problem(controller_shape, critic_shape, float(learning_rate), choose_device(device))
    _check(parents, critic, states, problem)
    offspring = np.empty_like(parents)
    if not len(parents):
        return offspring
    own = states.ndim == 4
    # A CPU is fastest with one offspring at a time, whose activations stay in its cache; a GPU with
    # all at once.
    size = 1 if problem.device.type == "cpu" else len(parents)
    chunks = [slice(i, i + size) for i in range(0, len(parents), size)]
    todo = iter(chunks)  # all threads take from it

    def climb(goes_on: GoesOn) -> None:
        torch.set_num_threads(threads)  # torch keeps this number per thread, too
        with torch.no_grad():
            climber = _Climber(problem, critic, size, states.shape[-2])
            for chunk in todo:
                batches = states[chunk] if own else states[None]
                offspring[chunk] = climber.climb(parents[chunk], batches)
                if not goes_on():
                    break

    with torch_threads(threads):
        do_with_helpers(climb, min(workers, len(chunks)) - 1)
    return offspring


@dataclass(frozen=True)
class _Problem:
    """What all offspring of a call have in common."""

    controller_shape: MlpShape
    critic_shape: MlpShape
    learning_rate: float
    device: torch.device


class _Climber:
    """E offspring under way, with the memory for it.

    Each chunk of parents is copied to the same place: a matrix product may round otherwise at
    another alignment, so rows of a larger array would not give the same bits as the same offspring
    alone.
    """

    def __init__(self, problem: _Problem, critic: Vector, size: int, rows: int) -> None:
        self._device = problem.device
        self._learning_rate = problem.learning_rate
        count = problem.controller_shape.parameter_count
        self._controllers = torch.zeros((size, count), device=problem.device)
        # All follow the same critic; repeated so that a batched product takes them side by side.
        q1 = torch.from_numpy(critic.copy()).to(problem.device).repeat(size, 1)
        self._ascent = value_ascent(
            self._controllers, problem.controller_shape, q1, problem.critic_shape, rows
        )
        self._adam = flat_adam(self._controllers)

    def climb(self, parents: Float32Array, batches: Float32Array) -> Float32Array:
        """Return (E, P) offspring of (E, P) parents for batches (E or 1, n_grad, N, obs_dim)."""
        self._controllers.copy_(torch.from_numpy(parents.copy()))
        reset_adam(self._adam)
        states = list(torch.from_numpy(batches).to(self._device).unbind(1))
        climb_on(self._ascent, self._adam, states, self._learning_rate)
        return self._controllers.cpu().numpy()


def _check(parents: Float32Array, critic: Vector, states: Float32Array, problem: _Problem) -> None:
    controllers, critics = problem.controller_shape, problem.critic_shape
    obs_dim, act_dim = controllers.sizes[0], controllers.sizes[-1]
    if critics.sizes[0] != obs_dim + act_dim or critics.sizes[-1] != 1:
        raise NetworkError(
            f"A critic with layers {list(critics.sizes)} cannot judge controllers with layers "
            f"{list(controllers.sizes)}: it must take {obs_dim} + {act_dim} numbers and give one."
        )
    critics.check(critic)
    if parents.ndim != 2:
        raise NetworkError(f"Parents have shape {parents.shape}, expected (n, P).")
    for parent in parents:
        controllers.check(parent)
    shared = states.ndim == 3 or (states.ndim == 4 and len(states) == len(parents))
    if not shared or states.shape[-1] != obs_dim or states.dtype != np.float32:
        raise NetworkError(
            f"State batches are {states.dtype} {states.shape}, expected float32 "
            f"(n_grad, N, {obs_dim}) or ({len(parents)}, n_grad, N, {obs_dim})."
        )
    if 0 in states.shape[-3:-1]:
        raise NetworkError(f"State batches {states.shape} hold no states; give at least one.")
