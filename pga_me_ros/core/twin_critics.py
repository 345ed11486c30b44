"""The critics Q1 and Q2 with their targets and optimisers (Eq. 5 of Nilsson & Cully 2021)."""

from __future__ import annotations

import torch
from torch import Tensor

from pga_me_ros.core.policy import MlpShape
from pga_me_ros.core.torch_nets import FlatAdam, MlpStack
from pga_me_ros.core.training_batch import TrainingBatch


class CriticPart:
    """Critics that are computed at once: one of them on a CPU, both on a GPU.

    Attributes:
        online: The critics, E of them.
        target: (E, P) float32, their targets.
        adam: Their optimiser.
        loss: Sum over steps and transitions of their squared errors, a scalar.
        value: Sum over steps and transitions of what the first of them returned, a scalar.

    Args:
        shape: Layers of each critic.
        parameters: (E, P) float32, which training changes in place.
        rows: N, transitions per batch.
    """

    def __init__(self, shape: MlpShape, parameters: Tensor, rows: int) -> None:
        """Copy the critics into their targets (Alg. 3, line 4)."""
        self.online = MlpStack(shape, parameters, rows, tanh=False)
        self.target = parameters.clone()
        self.adam = FlatAdam(parameters)
        self.loss, self.value = parameters.new_zeros(()), parameters.new_zeros(())
        self._error = parameters.new_empty((len(parameters), rows, 1))

    def descend(self, batches: list[TrainingBatch], learning_rate: float) -> None:
        """Take one step down the mean squared error on each batch (Alg. 4, line 6); add to the sums."""
        for batch in batches:
            q = self.online.forward(batch.inputs)
            self.value += q[0].sum()
            error = torch.sub(q, batch.y, out=self._error)
            flat = error.flatten()
            self.loss += torch.dot(flat, flat)
            self.online.backward(batch.inputs, error.mul_(2.0 / len(batch.y)))
            self.adam.step(self.online.gradient, learning_rate)

    def tensors(self) -> dict[str, Tensor]:
        """Return what the next step depends on, each of first dimension E, and the optimiser's steps."""
        return {
            "critics": self.online.parameters,
            "critic_targets": self.target,
            "critic_moment1": self.adam.moment1,
            "critic_moment2": self.adam.moment2,
            "critic_steps": self.adam.steps,
        }


class TwinCritics:
    """Both critics.

    A CPU computes them one by one, which keeps their signals in its cache. Neither depends on the other but through the
    targets of a whole block of steps, so two threads compute them with hardly a word between them.

    Args:
        shape: Layers of each critic.
        parameters: (2, P) float32 to start from.
        rows: N, transitions per batch.

    Attributes:
        parts: Q1 and Q2 on a CPU, one part with both on a GPU.
    """

    def __init__(self, shape: MlpShape, parameters: Tensor, rows: int) -> None:
        """Divide the critics into parts."""
        size = 1 if parameters.device.type == "cpu" else len(parameters)
        self.parts = [CriticPart(shape, chunk.clone(), rows) for chunk in parameters.split(size)]

    def take_sums(self) -> tuple[float, float]:
        """Return the sums of both critics' loss and of the first's value, and begin them anew."""
        sums = sum(part.loss.item() for part in self.parts), self.parts[0].value.item()
        for part in self.parts:
            part.loss.zero_()
            part.value.zero_()
        return sums

    def state(self) -> dict[str, Tensor]:
        """Return everything that the next step depends on: (2, P) tensors and the number of steps; copies."""
        parts = [part.tensors() for part in self.parts]
        return {
            name: torch.cat([p[name] for p in parts]) if tensor.ndim else tensor.clone()
            for name, tensor in parts[0].items()
        }

    def load_state(self, state: dict[str, Tensor]) -> None:
        """Continue from tensors like those of `state`."""
        start = 0
        for part in self.parts:
            end = start + len(part.online.parameters)
            for name, tensor in part.tensors().items():
                tensor.copy_(state[name][start:end] if tensor.ndim else state[name])
            start = end
