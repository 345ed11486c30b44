"""Critic training: TRAIN_CRITIC, Alg. 4 and Eq. 5 of Nilsson & Cully (2021).

It is TD3 (Fujimoto et al. 2018) with the greedy controller as the actor.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.gradients.adam import adam_step, make_adam, reset_adam
from pga_me_ros.core.gradients.device import choose_device, torch_threads
from pga_me_ros.core.gradients.threads import PairOfThreads
from pga_me_ros.core.gradients.value_ascent import climb, make_value_ascent
from pga_me_ros.core.learning.bellman_target import BellmanTarget
from pga_me_ros.core.learning.replay_buffer import TransitionSource
from pga_me_ros.core.learning.training_batch import TrainingBatch
from pga_me_ros.core.learning.twin_critics import TwinCritics
from pga_me_ros.core.networks.mlp import random_critic, random_parameters
from pga_me_ros.core.networks.shapes import RobotDimensions, controller_shape, critic_shape
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import NetworkError, StorageError

BLOCK = 8
"""Maximum number of steps that are prepared together; more would cost memory and gain nothing."""


class CriticTrainer:
    """The critics Q1 and Q2, the greedy controller, their targets and their optimizers.

    Args:
        spec: Spec of the task, for its dimensions.
        settings: Settings of the run; only rates may change later.
        workers: Threads; with more than one, a CPU trains the second critic at the same time as the first. The results
            do not depend on it.
        purpose: Purpose of the random draws of its training.
        first_draw: Index of its first draw for `Purpose.CRITIC_INIT`; it uses three.

    Raises:
        SettingsError: The device cannot be used here.
    """

    def __init__(
        self,
        spec: RobotDimensions,
        settings: Settings,
        workers: int = 1,
        purpose: Purpose = Purpose.CRITIC_TRAINING,
        first_draw: int = 0,
    ) -> None:
        """Draw the networks and copy them into their targets (Alg. 3, lines 3-5)."""
        self.settings = settings
        self._purpose = purpose
        self.obs_dim, self.act_dim = spec.observation_dim, spec.action_dim
        self.critic_shape = critic_shape(spec, settings)
        self.greedy_shape = controller_shape(spec, settings)
        self.device = choose_device(settings.device)

        def draw(index: int) -> np.random.Generator:
            return generator(settings.seed, Purpose.CRITIC_INIT, 0, first_draw + index)

        critics = np.stack([random_critic(self.critic_shape, draw(i)) for i in range(2)])
        greedy = random_parameters(self.greedy_shape, draw(2))[None]
        rows = settings.transition_batch
        self._critics = TwinCritics(
            self.critic_shape, torch.from_numpy(critics).to(self.device), rows
        )
        self._greedy = torch.from_numpy(greedy).to(self.device)
        self._greedy_adam = make_adam(self._greedy)
        self._greedy_target = self._greedy.clone()
        parts = self._critics.parts
        # One per part, so that two threads share this work, too.
        self._targets = [
            BellmanTarget(
                self.greedy_shape,
                self._greedy_target,
                self.critic_shape,
                [part.target for part in parts],
                rows,
            )
            for _ in parts
        ]
        q1 = parts[0].online[:1]
        self._ascents = [
            make_value_ascent(
                self._greedy, self.greedy_shape, q1, self.critic_shape, len(share), 1.0 / rows
            )
            for share in torch.empty(rows).chunk(len(parts))
        ]
        self._batches = [
            TrainingBatch(rows, self.obs_dim, self.act_dim, self.device) for _ in range(BLOCK)
        ]
        self._side_by_side = PairOfThreads(workers, settings.torch_threads)

    def train(
        self,
        replay: TransitionSource,
        settings: Settings,
        generation: int,
        steps: range | None = None,
    ) -> dict[str, float]:
        """Train for n_crit steps: Alg. 4.

        Args:
            replay: Transitions to draw from.
            settings: Settings of the run with the rates in force; only rates may differ from those
                given first.
            generation: Number of the generation, which determines all draws.
            steps: Numbers of the steps, at least one; 1 to n_crit by default.

        Returns:
            Means over the steps: 'critic_loss', and 'mean_q' of Q1 on the batch.

        Raises:
            PgaError: The replay buffer is empty.
            NetworkError: The training diverged: the loss is not finite.
        """
        rng = generator(self.settings.seed, self._purpose, generation)
        steps = range(1, settings.n_crit + 1) if steps is None else steps
        with torch.no_grad(), torch_threads(self.settings.torch_threads):
            for block in blocks(steps, settings.target_period):
                self._train_block(replay, settings, rng, block)
        loss, value = self._critics.take_sums()
        rows = self.settings.transition_batch
        stats = {
            "critic_loss": loss / (len(steps) * rows),
            "mean_q": value / (len(steps) * rows),
        }
        if not math.isfinite(stats["critic_loss"]):
            raise NetworkError(
                f"Critic training diverged in generation {generation}: the loss is "
                f"{stats['critic_loss']}. Try a smaller critic_learning_rate or discount."
            )
        return stats

    def _train_block(
        self, replay: TransitionSource, rates: Settings, rng: np.random.Generator, block: range
    ) -> None:
        """Take steps during which the targets do not move (Alg. 4, lines 3-11)."""
        batches = self._batches[: len(block)]
        for batch in batches:
            batch.draw(replay, rng)

        def prepare(target: BellmanTarget, share: list[TrainingBatch]) -> None:
            for batch in share:
                batch.gather(replay, rates)
            target.fill([batch.transitions for batch in share], rates)

        n = len(self._targets)
        jobs = [partial(prepare, t, batches[i::n]) for i, t in enumerate(self._targets)]
        self._side_by_side(*jobs)
        parts = self._critics.parts
        transitions = [batch.transitions for batch in batches]
        shares = transitions[-1].states.chunk(len(parts), dim=1)
        targets_move = block[-1] % rates.target_period == 0
        q1_trained = threading.Event()

        def learn(i: int) -> None:
            try:
                parts[i].descend(transitions, rates.critic_learning_rate)
            finally:
                if i == 0:
                    q1_trained.set()
            if not targets_move:
                return
            if i < len(shares):  # a batch of one transition makes one share
                q1_trained.wait()
                # Climb the greedy controller's mean Q1(s, pi(s)) (Alg. 4, lines 8-9) on a share of the states.
                climb(self._ascents[i], shares[i])
            parts[i].move_target(rates.target_rate)

        self._side_by_side(*(partial(learn, i) for i in range(len(parts))))
        if targets_move:
            self._step_greedy(rates)

    def _step_greedy(self, rates: Settings) -> None:
        """Move the greedy controller up the gradient, and its target by tau towards it (Alg. 4, lines 9-11)."""
        gradient = self._ascents[0].controllers.gradient
        for other in self._ascents[1:]:
            gradient += other.controllers.gradient
        adam_step(self._greedy_adam, gradient, rates.greedy_learning_rate, maximize=True)
        self._greedy_target.lerp_(self._greedy, rates.target_rate)

    def greedy_parameters(self) -> Float32Array:
        """Return the greedy controller: (P,) float32, a copy."""
        return self._greedy[0].cpu().numpy().copy()

    def critic_parameters(self) -> Float32Array:
        """Return critic Q1: (P,) float32, a copy."""
        return self._critics.parts[0].online[0].cpu().numpy().copy()

    def set_greedy(self, parameters: Float32Array) -> None:
        """Start the greedy controller and its target from given parameters (greedy_init 'best').

        Args:
            parameters: (P,) float32 of a controller.

        Raises:
            NetworkError: The parameters do not fit the controllers' layers, or are not finite.
        """
        self.greedy_shape.check(parameters)
        for tensor in (self._greedy, self._greedy_target):
            tensor.copy_(torch.from_numpy(parameters.copy())[None])
        reset_adam(self._greedy_adam)

    def state(self) -> dict[str, Float32Array]:
        """Return everything that the next step depends on, as named float32 arrays (copies)."""
        tensors = self._critics.state() | self._greedy_tensors()
        return {name: t.cpu().numpy().copy() for name, t in tensors.items()}

    def load_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from what `state` returned, bit for bit.

        Raises:
            StorageError: Arrays are missing or belong to other layer sizes; the trainer is then
                unchanged.
        """
        critics, greedy = self._critics.state(), self._greedy_tensors()
        for name, tensor in (critics | greedy).items():
            array = state.get(name)
            if array is None or array.dtype != np.float32 or array.shape != tensor.shape:
                got = "is missing" if array is None else f"is {array.dtype} {array.shape}"
                raise StorageError(
                    f"Saved critic array '{name}' {got}, expected float32 {tuple(tensor.shape)}; "
                    "resume with the task and layer sizes that the run was started with."
                )
        self._critics.load_state(
            {name: torch.from_numpy(np.array(state[name])) for name in critics}
        )
        for name, tensor in greedy.items():
            tensor.copy_(torch.from_numpy(np.array(state[name])))

    def _greedy_tensors(self) -> dict[str, Tensor]:
        return {
            "greedy": self._greedy,
            "greedy_target": self._greedy_target,
            "greedy_moment1": self._greedy_adam.moment1[0],
            "greedy_moment2": self._greedy_adam.moment2[0],
            "greedy_steps": self._greedy_adam.steps[0],
        }


def blocks(steps: range, period: int) -> Iterator[range]:
    """Divide steps into blocks of at most `BLOCK`, so that the targets move only after the last step of a block.

    Args:
        steps: Numbers of the steps.
        period: The targets move after steps whose number is a multiple of it.
    """
    start = steps.start
    while start < steps.stop:
        next_move = start + -start % period
        stop = min(next_move + 1, start + BLOCK, steps.stop)
        yield range(start, stop)
        start = stop
