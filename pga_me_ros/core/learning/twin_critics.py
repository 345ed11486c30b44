"""The critics Q1 and Q2 with their targets and optimizers (Eq. 5 of Nilsson & Cully 2021)."""

# Annotations must stay types: see `compiled`.
import torch
from torch import Tensor

from pga_me_ros.core.gradients.adam import Adam, adam_step, make_adam
from pga_me_ros.core.gradients.batched_mlp import BatchedMlp, backward, forward, make_batched_mlp
from pga_me_ros.core.gradients.compiled import compiled
from pga_me_ros.core.learning.training_batch import Transitions
from pga_me_ros.core.networks.mlp import MlpShape


class CriticPart:
    """Critics that are computed at once: one on a CPU, both on a GPU.

    Attributes:
        online: (E, P) float32, the critics.
        target: (E, P) float32, their targets.
        adam: Their optimizer.
        loss: Sum over steps and transitions of their squared errors, a scalar.
        value: Sum over steps and transitions of the first critic's values, a scalar.

    Args:
        shape: Layers of each critic.
        parameters: (E, P) float32, which training changes in place.
        rows: N, transitions per batch.
    """

    def __init__(self, shape: MlpShape, parameters: Tensor, rows: int) -> None:
        """Copy the critics into their targets (Alg. 3, line 4)."""
        self.online = parameters
        self.target = parameters.clone()
        self.adam = make_adam(parameters)
        self.loss, self.value = parameters.new_zeros(()), parameters.new_zeros(())
        self._critics = make_batched_mlp(shape, parameters, rows, tanh=False)
        self._error = parameters.new_empty((len(parameters), rows, 1))

    def descend(self, batches: list[Transitions], learning_rate: float) -> None:
        """Take one step down the mean squared error on each batch (Alg. 4, line 6); add to the sums."""
        _descend(
            self._critics,
            self.adam,
            batches,
            learning_rate,
            self._error,
            self.loss,
            self.value,
        )

    def move_target(self, rate: float) -> None:
        """Move the targets by tau towards their critics (Eq. 4; Alg. 4, line 10)."""
        self.target.lerp_(self.online, rate)

    def tensors(self) -> dict[str, Tensor]:
        """Return what the next step depends on: tensors whose first dimension is E, and the optimizer's step count."""
        return {
            "critics": self.online,
            "critic_targets": self.target,
            "critic_moment1": self.adam.moment1[0],
            "critic_moment2": self.adam.moment2[0],
            "critic_steps": self.adam.steps[0],
        }


@compiled
def _descend(
    critics: BatchedMlp,
    adam: Adam,
    batches: list[Transitions],
    learning_rate: float,
    error: Tensor,
    loss: Tensor,
    value: Tensor,
) -> None:
    for batch in batches:
        q = forward(critics, batch.inputs)
        value.add_(q[0].sum())
        torch.sub(q, batch.y, out=error)
        flat = error.flatten()
        loss.add_(torch.dot(flat, flat))
        error.mul_(2.0 / len(batch.y))
        backward(critics, batch.inputs, error)
        adam_step(adam, critics.gradient, learning_rate, maximize=False)


class TwinCritics:
    """Both critics.

    A CPU computes them one by one, so that activations stay in its cache. They depend on each other only through the
    targets of a whole block of steps, so two threads can compute them almost independently.

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
        """Return the sums of both critics' loss and of the first's value, and reset them."""
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
            end = start + len(part.online)
            for name, tensor in part.tensors().items():
                tensor.copy_(state[name][start:end] if tensor.ndim else state[name])
            start = end
