"""Critic training: TRAIN_CRITIC, Alg. 4 and Eq. 5 of Nilsson & Cully (2021).

It is TD3 (Fujimoto et al. 2018) with a greedy controller in the place of the actor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pga_me_ros.core.errors import NetworkError, StorageError
from pga_me_ros.core.policy import (
    RobotDimensions,
    Vector,
    controller_shape,
    critic_shape,
    random_critic,
    random_parameters,
)
from pga_me_ros.core.replay import TransitionSource
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.torch_nets import FlatAdam, MlpStack, choose_device, torch_threads


class CriticTrainer:
    """The critics Q1 and Q2, the greedy controller, their targets and their optimisers.

    Both critics are one (2, P) tensor.

    Args:
        spec: Spec of the task, for its dimensions.
        settings: Settings of the run; of them, those that are no rates hold for good.
        workers: Threads; with more than one, a CPU computes the second critic at the same time as the first. The
            results do not depend on it.
        purpose: What the draws of its training are for.
        first_draw: Index of its first draw for `Purpose.CRITIC_INIT`; it takes three.

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
        self._pool = self._second_thread() if workers > 1 else None
        self._critics = self._stack(critics, greedy=False)
        self._critic_targets = self._stack(critics, greedy=False)
        self._greedy = self._stack(greedy, greedy=True)
        self._greedy_target = self._stack(greedy, greedy=True)
        # Q1 alone, on the same memory: the critic that controllers follow.
        rows = settings.transition_batch
        self._critic1 = MlpStack(self.critic_shape, self._critics.parameters[:1], rows, tanh=False)
        self._critic_adam = FlatAdam(self._critics.parameters)
        self._greedy_adam = FlatAdam(self._greedy.parameters)
        self._batch = np.empty((rows, 2 * self.obs_dim + self.act_dim + 2), np.float32)
        self._critic_input = self._zeros(1, rows, self.obs_dim + self.act_dim)
        self._action_gradient = self._zeros(1, rows, self.act_dim)

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
            settings: Those of the run with the rates that hold now; only rates may differ from the
                first.
            generation: Number of the generation, from which all draws follow.
            steps: Numbers of the steps, at least one, in place of 1 to n_crit.

        Returns:
            Means over the steps: 'critic_loss', 'mean_q' (of Q1 on the batch) and
            'greedy_objective' (mean Q1 of the greedy controller's actions, NaN if it was not
            updated).

        Raises:
            PgaError: The replay buffer is empty.
            NetworkError: The networks are no longer finite.
        """
        rng = generator(self.settings.seed, self._purpose, generation)
        steps = range(1, settings.n_crit + 1) if steps is None else steps
        loss, value = self._zeros(), self._zeros()
        objective = self._zeros()
        with torch.no_grad(), torch_threads(self.settings.torch_threads):
            for t in steps:
                batch = self._sample(replay, rng)
                noise = self._smoothing_noise(settings, rng)
                y = self._bellman_target(batch, noise, settings)
                self._update_critics(batch, y, settings, loss, value)
                if t % settings.target_period == 0:
                    self._update_greedy(batch, settings, objective)
                    self._update_targets(settings)
        n_greedy = len([t for t in steps if t % settings.target_period == 0])
        stats = {
            "critic_loss": loss.item() / len(steps),
            "mean_q": value.item() / len(steps),
            "greedy_objective": objective.item() / n_greedy if n_greedy else math.nan,
        }
        if not math.isfinite(stats["critic_loss"]):
            raise NetworkError(
                f"Critic training diverged in generation {generation}: the loss is "
                f"{stats['critic_loss']}. Try a smaller critic_learning_rate or discount."
            )
        return stats

    def _sample(self, replay: TransitionSource, rng: np.random.Generator) -> Tensor:
        """Draw N transitions (Alg. 4, line 3): rows [s, a, s', r, not_done]."""
        replay.rows(replay.sample_indices(rng, len(self._batch)), out=self._batch)
        return torch.from_numpy(self._batch).to(self.device)

    def _smoothing_noise(self, rates: Settings, rng: np.random.Generator) -> Tensor:
        """Draw the smoothing noise epsilon (Alg. 4, line 4)."""
        noise = rng.standard_normal((len(self._batch), self.act_dim), np.float32)
        noise *= np.float32(rates.smoothing_sigma)
        np.clip(noise, -rates.smoothing_clip, rates.smoothing_clip, out=noise)
        return torch.from_numpy(noise).to(self.device)

    def _bellman_target(self, batch: Tensor, noise: Tensor, rates: Settings) -> Tensor:
        """Return y (N, 1) of Eq. 5 (Alg. 4, line 5)."""
        next_states = batch[:, self.obs_dim + self.act_dim : -2]
        next_actions = self._critic_input[0, :, self.obs_dim :]
        self._critic_input[0, :, : self.obs_dim] = next_states
        torch.add(self._greedy_target.forward(next_states)[0], noise, out=next_actions)
        if self.settings.target_action == "clip":
            next_actions.clamp_(-1.0, 1.0)
        q = self._critic_targets.forward(self._critic_input)
        y = torch.minimum(q[0], q[1]).mul_(rates.discount)
        if self.settings.terminal == "mask":
            y.mul_(batch[:, -1:])
        return y.add_(batch[:, -2:-1])

    def _update_critics(
        self, batch: Tensor, y: Tensor, rates: Settings, loss: Tensor, value: Tensor
    ) -> None:
        """Descend the mean squared error of both critics (Alg. 4, line 6).

        Adds to the sums of loss and of mean Q1.
        """
        inputs = batch[:, : self.obs_dim + self.act_dim]
        q = self._critics.forward(inputs)
        value += q[0].mean()
        error = q - y
        loss += error.square().sum() / len(batch)
        self._critics.backward(inputs, error.mul_(2.0 / len(batch)))
        self._critic_adam.step(self._critics.gradient, rates.critic_learning_rate)

    def _update_greedy(self, batch: Tensor, rates: Settings, objective: Tensor) -> None:
        """Ascend mean Q1(s, pi(s)) of the greedy controller (Alg. 4, lines 8-9); add to its sum."""
        states = batch[:, : self.obs_dim]
        self._critic_input[0, :, : self.obs_dim] = states
        self._critic_input[:, :, self.obs_dim :] = self._greedy.forward(states)
        q = self._critic1.forward(self._critic_input)
        objective += q.mean()
        per_row = torch.full_like(q, 1.0 / len(batch))
        self._critic1.input_gradient(per_row, self.obs_dim, out=self._action_gradient)
        self._greedy.backward(states, self._action_gradient)
        self._greedy_adam.step(self._greedy.gradient, rates.greedy_learning_rate, maximize=True)

    def _update_targets(self, rates: Settings) -> None:
        """Move the targets by tau towards their networks (Eq. 4; Alg. 4, lines 10-11)."""
        self._critic_targets.parameters.lerp_(self._critics.parameters, rates.target_rate)
        self._greedy_target.parameters.lerp_(self._greedy.parameters, rates.target_rate)

    def greedy_parameters(self) -> Vector:
        """Return the greedy controller: (P,) float32, a copy."""
        return self._greedy.parameters[0].cpu().numpy().copy()

    def critic_parameters(self, index: int = 0) -> Vector:
        """Return critic Q1 (index 0) or Q2 (1): (P,) float32, a copy."""
        return self._critics.parameters[index].cpu().numpy().copy()

    def set_greedy(self, parameters: Vector) -> None:
        """Start the greedy controller and its target from given parameters (greedy_init 'best').

        Args:
            parameters: (P,) float32 of a controller.

        Raises:
            NetworkError: They do not fit the controllers' layers.
        """
        self.greedy_shape.check(parameters)
        for stack in (self._greedy, self._greedy_target):
            stack.parameters.copy_(torch.from_numpy(parameters.copy())[None])
        self._greedy_adam.reset()

    def state(self) -> dict[str, NDArray[np.float32]]:
        """Return everything that the next step depends on, as named float32 arrays (copies)."""
        return {name: t.cpu().numpy().copy() for name, t in self._state_tensors().items()}

    def load_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from what `state` returned, bit for bit.

        Raises:
            StorageError: Arrays are missing or belong to other layer sizes; nothing is changed
                then.
        """
        tensors = self._state_tensors()
        for name, tensor in tensors.items():
            array = state.get(name)
            if array is None or array.dtype != np.float32 or array.shape != tensor.shape:
                got = "is missing" if array is None else f"is {array.dtype} {array.shape}"
                raise StorageError(
                    f"Saved critic array '{name}' {got}, expected float32 {tuple(tensor.shape)}; "
                    "resume with the task and layer sizes that the run was started with."
                )
        for name, tensor in tensors.items():
            tensor.copy_(torch.from_numpy(np.array(state[name])))

    def _state_tensors(self) -> dict[str, Tensor]:
        return {
            "critics": self._critics.parameters,
            "critic_targets": self._critic_targets.parameters,
            "critic_moment1": self._critic_adam.moment1,
            "critic_moment2": self._critic_adam.moment2,
            "critic_steps": self._critic_adam.steps,
            "greedy": self._greedy.parameters,
            "greedy_target": self._greedy_target.parameters,
            "greedy_moment1": self._greedy_adam.moment1,
            "greedy_moment2": self._greedy_adam.moment2,
            "greedy_steps": self._greedy_adam.steps,
        }

    def _stack(self, parameters: NDArray[np.float32], *, greedy: bool) -> MlpStack:
        tensor = torch.from_numpy(parameters).to(self.device).clone()
        shape = self.greedy_shape if greedy else self.critic_shape
        rows = self.settings.transition_batch
        return MlpStack(shape, tensor, rows, tanh=greedy, pool=self._pool)

    def _second_thread(self) -> ThreadPoolExecutor | None:
        if self.device.type != "cpu":
            return None  # a GPU computes both at once

        def prepare() -> None:  # torch keeps these per thread
            torch.set_num_threads(self.settings.torch_threads)
            torch.set_grad_enabled(False)

        return ThreadPoolExecutor(1, initializer=prepare)

    def _zeros(self, *shape: int) -> Tensor:
        return torch.zeros(shape, device=self.device)
