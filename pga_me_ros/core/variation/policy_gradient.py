"""Policy gradient variation, VARIATION_PG of Alg. 5 (Nilsson & Cully 2021)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.gradients.adam import make_adam, reset_adam
from pga_me_ros.core.gradients.device import choose_device, torch_threads
from pga_me_ros.core.gradients.threads import GoesOn, run_with_helpers
from pga_me_ros.core.gradients.value_ascent import climb_on, make_value_ascent
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.errors import NetworkError, RequestError


def pg_variation(
    parents: Float32Array,
    critic: Float32Array,
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

    On a CPU an offspring depends on nothing but its parent, its critic, its states and `threads`:
    it is bit for bit the same alone, in any batch, and with any number of workers.

    Args:
        parents: (n, P) float32 controllers.
        critic: (P_critic,) float32, Q1, or (n, P_critic), one for each offspring; it stays as it is.
        states: (n_grad, N, obs_dim) float32 batches shared by all offspring, or (n, n_grad, N,
            obs_dim) with separate batches for each (setting pg_batches).
        learning_rate: Learning rate of Adam; each offspring starts with fresh moments.
        controller_shape: Layers of the controllers.
        critic_shape: Layers of the critic.
        threads: Threads of each matrix product (setting torch_threads); the last bits depend on it.
        workers: Maximum number of offspring computed at a time, each on its own thread if a core is free; affects only
            the speed. Not used on a GPU, which computes all offspring at once.
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
    own, own_critics = states.ndim == 4, critic.ndim == 2
    # A CPU is fastest with one offspring at a time, whose activations stay in its cache; a GPU with
    # all at once.
    size = 1 if problem.device.type == "cpu" else len(parents)
    chunks = [slice(i, i + size) for i in range(0, len(parents), size)]
    todo = iter(chunks)  # shared by all threads

    def climb(goes_on: GoesOn) -> None:
        torch.set_num_threads(threads)  # torch keeps this number per thread, too
        with torch.no_grad():
            climber = _Climber(problem, size, states.shape[-2])
            for chunk in todo:
                batches = states[chunk] if own else states[None]
                critics = critic[chunk] if own_critics else critic[None]
                offspring[chunk] = climber.climb(parents[chunk], critics, batches)
                if not goes_on():
                    break

    with torch_threads(threads):
        run_with_helpers(climb, min(workers, len(chunks)) - 1)
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

    Each chunk of parents and critics is copied to the same place: a matrix product may round otherwise
    at another alignment, so rows of a larger array would not give the same bits as the same offspring
    alone.
    """

    def __init__(self, problem: _Problem, size: int, rows: int) -> None:
        self._device = problem.device
        self._learning_rate = problem.learning_rate
        count = problem.controller_shape.parameter_count
        self._controllers = torch.zeros((size, count), device=problem.device)
        # One each, even where all follow the same critic, so that a batched product takes them side by side.
        self._critics = torch.zeros(
            (size, problem.critic_shape.parameter_count), device=problem.device
        )
        self._ascent = make_value_ascent(
            self._controllers, problem.controller_shape, self._critics, problem.critic_shape, rows
        )
        self._adam = make_adam(self._controllers)

    def climb(
        self, parents: Float32Array, critics: Float32Array, batches: Float32Array
    ) -> Float32Array:
        """Return (E, P) offspring of (E, P) parents up critics (E or 1, P) for batches (E or 1, n_grad, N, obs_dim)."""
        self._controllers.copy_(torch.from_numpy(parents.copy()))
        self._critics.copy_(torch.from_numpy(critics.copy()))
        reset_adam(self._adam)
        states = list(torch.from_numpy(batches).to(self._device).unbind(1))
        climb_on(self._ascent, self._adam, states, self._learning_rate)
        return self._controllers.cpu().numpy()


def _check(
    parents: Float32Array, critic: Float32Array, states: Float32Array, problem: _Problem
) -> None:
    controllers, critics = problem.controller_shape, problem.critic_shape
    obs_dim, act_dim = controllers.sizes[0], controllers.sizes[-1]
    if critics.sizes[0] != obs_dim + act_dim or critics.sizes[-1] != 1:
        raise NetworkError(
            f"A critic with layers {list(critics.sizes)} is incompatible with controllers of layers "
            f"{list(controllers.sizes)}: it must take {obs_dim} + {act_dim} numbers and give one."
        )
    for each in critic if critic.ndim == 2 else critic[None]:
        critics.check(each)
    if critic.ndim == 2 and len(critic) != len(parents):
        raise NetworkError(
            f"There are {len(critic)} critics for {len(parents)} parents; expected one, or one for each."
        )
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


def pg_states(snapshot: Snapshot, first: int, count: int) -> Float32Array:
    """Return the replay states that PG offspring at the given places climb on (Alg. 5 line 16).

    Args:
        snapshot: State of the critics for their generation.
        first: Place of the first one.
        count: Number of offspring.

    Returns:
        (n_grad, N, observation_dim) if all share them, else (count, n_grad, N, observation_dim).

    Raises:
        RequestError: The snapshot has no states for those places.
    """
    sets = len(snapshot.states)
    if sets == 1:
        return snapshot.states[0]
    if first + count > sets:
        raise RequestError(
            f"Places {first} to {first + count - 1} were requested, but the snapshot of generation "
            f"{snapshot.generation} has states for {sets} places."
        )
    return snapshot.states[first : first + count]
