"""A tiny task that follows the protocol, and others that each break it in one way."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar

import numpy as np

from pga_me_ros.tasks.protocol import NonFiniteActionError
from pga_me_ros.tasks.spec import TaskSpec

SPEC = TaskSpec(
    name="point",
    observation_names=("position", "velocity"),
    observation_units=("m", "m/s"),
    action_names=("force",),
    action_units=("N",),
    action_low=(-1.0,),
    action_high=(1.0,),
    descriptor_names=("share_right",),
    descriptor_low=(0.0,),
    descriptor_high=(1.0,),
    max_steps=50,
    control_period=0.1,
    archive_cells=10,
    archive_bins=(10,),
)


class Point:
    """A point mass on a line that falls off at ±2 m; no simulator needed."""

    spec: ClassVar[Any] = SPEC

    def __init__(self, *, render: bool = False) -> None:
        self.state = np.zeros(2)

    def reset(self, rng: np.random.Generator) -> Any:
        self.state = np.array([rng.uniform(-0.1, 0.1), 0.0])
        self.right = self.steps = 0
        return self.state.astype(np.float32)

    def step(self, action: Any) -> Any:
        if not np.isfinite(action).all():
            raise NonFiniteActionError("point got a force that is not finite")
        self.state = self.state + 0.1 * np.array([self.state[1], float(action[0])])
        self.steps += 1
        self.right += self.state[0] > 0
        fell = bool(abs(self.state[0]) > 2)
        return self.state.astype(np.float32), float(self.state[1]), fell

    def descriptor(self) -> Any:
        return np.array([self.right / max(self.steps, 1)])

    def close(self) -> None:
        pass


class TellsItsSide(Point):
    """Shows after each step whether it moved right."""

    spec = dataclasses.replace(SPEC, step_descriptor_names=("velocity",))

    def step(self, action: Any) -> Any:
        observation, reward, fell = super().step(action)
        observation[1] = self.state[0] > 0
        return observation, reward, fell


class TellsItsSideLate(TellsItsSide):
    """Shows after each step whether it moved right in the one before."""

    spec = dataclasses.replace(TellsItsSide.spec, step_descriptor_delay=1)

    def step(self, action: Any) -> Any:
        right = self.state[0] > 0 and self.steps > 0
        observation, reward, fell = super().step(action)
        observation[1] = right
        return observation, reward, fell


class TellsSomethingElse(TellsItsSide):
    spec = dataclasses.replace(SPEC, step_descriptor_names=("position",))


class NoSpec(Point):
    spec = None


class NoDescriptor(Point):
    descriptor = None  # type: ignore[assignment]


class StartRaises(Point):
    def __init__(self) -> None:
        raise RuntimeError("no simulator here")


class ResetRaises(Point):
    def reset(self, rng: np.random.Generator) -> Any:
        raise KeyError("pose")


class DoubleObservation(Point):
    def reset(self, rng: np.random.Generator) -> Any:
        return super().reset(rng).astype(np.float64)


class LongObservation(Point):
    def step(self, action: Any) -> Any:
        observation, reward, fell = super().step(action)
        return np.append(observation, np.float32(0)), reward, fell


class NanObservation(Point):
    def step(self, action: Any) -> Any:
        _, reward, fell = super().step(action)
        return np.full(2, np.nan, np.float32), reward, fell


class GymStep(Point):
    def step(self, action: Any) -> Any:
        return (*super().step(action), False, {})


class NumpyReward(Point):
    def step(self, action: Any) -> Any:
        observation, reward, fell = super().step(action)
        return observation, np.float64(reward), fell


class NumpyTerminated(Point):
    def step(self, action: Any) -> Any:
        observation, reward, fell = super().step(action)
        return observation, reward, np.bool_(fell)


class WideDescriptor(Point):
    def descriptor(self) -> Any:
        return 2.0 + super().descriptor()


class RemembersPose(Point):
    def reset(self, rng: np.random.Generator) -> Any:
        velocity = self.state[1]
        super().reset(rng)
        self.state[1] = 0.01 * velocity
        return self.state.astype(np.float32)


class SharedState(Point):
    made: ClassVar[int] = 0

    def __init__(self) -> None:
        super().__init__()
        SharedState.made += 1
        self.number = SharedState.made

    def reset(self, rng: np.random.Generator) -> Any:
        super().reset(rng)
        self.state[0] += 0.001 * self.number
        return self.state.astype(np.float32)


class LateNan(Point):
    def step(self, action: Any) -> Any:
        observation, reward, fell = super().step(action)
        return observation, float("nan") if self.steps == 20 else reward, fell


class TakesNan(Point):
    def step(self, action: Any) -> Any:
        return super().step(np.nan_to_num(action))


class WrongErrorForNan(Point):
    def step(self, action: Any) -> Any:
        if not np.isfinite(action).all():
            raise AssertionError("finite actions only")
        return super().step(action)


class SpoiltByNan(Point):
    spoilt = False

    def step(self, action: Any) -> Any:
        self.spoilt = self.spoilt or not np.isfinite(action).all()
        observation, reward, fell = super().step(action)
        return observation, reward + self.spoilt, fell


class ClosesOnce(Point):
    closed = False

    def close(self) -> None:
        if self.closed:
            raise RuntimeError("already closed")
        self.closed = True


class Diverges(Point):
    """Diverges in its tenth step and reports it."""

    def step(self, action: Any) -> Any:
        observation, reward, fell = super().step(action)
        if self.steps == 10:
            return np.full(2, np.nan, np.float32), float("nan"), True
        return observation, reward, fell


class SameArrays(Point):
    """Returns the same arrays every time, with new content."""

    def __init__(self, *, render: bool = False) -> None:
        super().__init__(render=render)
        self._observation, self._descriptor = np.zeros(2, np.float32), np.zeros(1)

    def reset(self, rng: np.random.Generator) -> Any:
        self._observation[:] = super().reset(rng)
        return self._observation

    def step(self, action: Any) -> Any:
        self._observation[:], reward, fell = super().step(action)
        return self._observation, reward, fell

    def descriptor(self) -> Any:
        self._descriptor[:] = super().descriptor()
        return self._descriptor


class SameArrayThatRemembers(SameArrays):
    """Its descriptor depends on earlier episodes."""

    episodes = 0

    def reset(self, rng: np.random.Generator) -> Any:
        self.episodes += 1
        return super().reset(rng)

    def descriptor(self) -> Any:
        self._descriptor[:] = super().descriptor() / self.episodes
        return self._descriptor


class HugeReward(Point):
    """Gives a reward within the range of float64 but not of float32."""

    def step(self, action: Any) -> Any:
        observation, _, fell = super().step(action)
        return observation, 1e39, fell


class HugeRewardAtTheEnd(Point):
    """Its simulation explodes in the tenth step, and it reports that."""

    def step(self, action: Any) -> Any:
        observation, reward, fell = super().step(action)
        return (observation, -1e300, True) if self.steps == 10 else (observation, reward, fell)


class LateHugeReward(Point):
    def step(self, action: Any) -> Any:
        observation, reward, fell = super().step(action)
        return observation, 1e39 if self.steps == 20 else reward, fell


class FailsLate(Point):
    """Fails only near the end of a long episode."""

    spec = dataclasses.replace(SPEC, max_steps=200)

    def step(self, action: Any) -> Any:
        observation, reward, _ = super().step(0.0 * np.asarray(action))
        if self.steps == 190:
            raise RuntimeError("buffer is full")
        return observation, reward, False


class NanDescriptor(Point):
    def descriptor(self) -> Any:
        return super().descriptor() if self.steps < 5 else np.array([np.nan])


class ShortObservation(Point):
    def step(self, action: Any) -> Any:
        observation, reward, fell = super().step(action)
        return observation if self.steps < 5 else observation[:1], reward, fell


class StartExits(Point):
    def __init__(self, *, render: bool = False) -> None:
        raise SystemExit("no license")


class StepExits(Point):
    def step(self, action: Any) -> Any:
        if self.steps == 5:
            raise SystemExit(0)
        return super().step(action)


class CloseExits(Point):
    def close(self) -> None:
        raise SystemExit(0)
