"""The guard's rules, each on its own, and what holds whatever happens."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pga_me_ros.hardware.guard import Guard, Limits, State, ramp_steps

LIMITS = Limits(np.array([-2.0, -8.0]), np.array([2.0, 8.0]), np.array([1.5, 100.0]))
AT_REST = np.array([0.5, 1.0])


def guard(**changed: Any) -> Guard:
    options = {"ramp_steps": 0, "positions": False, "hold": False, "resume": False}
    return Guard(LIMITS, **{**options, **changed})


def command(guard: Guard, *wanted: float) -> list[float]:
    out = guard.command(np.array(wanted))
    assert out is not None
    return out.tolist()


def moved(guard: Guard, *wanted: float) -> list[float]:
    out = guard.command(np.array(wanted), AT_REST)
    assert out is not None
    return out.tolist()


def test_what_is_within_all_limits_passes_unchanged() -> None:
    g = guard()
    wanted = [0.1, 1.0 / 3.0]
    assert command(g, *wanted) == wanted
    assert g.state is State.RUNNING


def test_efforts_ramp_in_from_zero() -> None:
    g = guard(ramp_steps=4)
    assert [command(g, 1.0, 8.0)[1] for _ in range(3)] == [2.0, 4.0, 6.0]
    assert g.state is State.RAMPING
    assert command(g, 1.0, 8.0)[1] == 8.0
    assert g.state is State.RUNNING


def test_positions_ramp_in_from_where_the_joints_are() -> None:
    g = guard(ramp_steps=4, positions=True)
    assert [moved(g, 1.5, 3.0) for _ in range(2)] == [[0.75, 1.5], [1.0, 2.0]]


def test_commands_are_limited_in_size() -> None:
    assert command(guard(), 0.0, -9.0)[1] == -8.0


def test_commands_are_limited_in_change() -> None:
    g = guard()
    assert [command(g, 2.0, 0.0)[0] for _ in range(2)] == [1.5, 2.0]
    assert command(g, -2.0, 0.0)[0] == 0.5


def test_a_joint_beyond_its_range_is_led_back_no_faster_than_allowed() -> None:
    g = guard(positions=True)
    far = np.array([5.0, 0.0])
    assert [g.command(far, far)[0] for _ in range(3)] == [3.5, 2.0, 2.0]  # type: ignore[index]


def test_before_all_sensors_are_known_nothing_is_commanded() -> None:
    g = guard()
    assert g.freeze("imu was never heard") is None
    assert (g.state, g.reason) == (State.WAITING, "")


def test_a_freeze_lasts_until_it_is_released_and_then_ramps_in_again() -> None:
    g = guard(ramp_steps=2)
    for _ in range(2):
        command(g, 1.0, 8.0)
    assert g.freeze("imu is 0.2 s old") is not None
    assert (g.state, g.reason) == (State.FROZEN, "imu is 0.2 s old")
    assert command(g, 1.0, 8.0) == [0.0, 0.0]
    g.release()
    assert command(g, 1.0, 8.0) == [0.5, 4.0]
    assert (g.state, g.reason) == (State.RAMPING, "")


def test_a_release_while_a_sensor_is_still_silent_freezes_again() -> None:
    g = guard(hold=True)
    held = command(g, 1.0, 8.0)
    g.freeze("imu is 0.2 s old")
    g.release()
    assert g.freeze("imu is 0.4 s old").tolist() == held  # type: ignore[union-attr]
    assert (g.state, g.reason) == (State.FROZEN, "imu is 0.4 s old")
    assert g.freeze("imu is 0.6 s old") is not None
    assert g.reason == "imu is 0.4 s old"


def test_efforts_that_were_held_are_what_a_ramp_begins_with() -> None:
    g = guard(ramp_steps=4, hold=True)
    for _ in range(8):
        command(g, 2.0, 8.0)
    g.freeze("late")
    g.release()
    assert [command(g, -2.0, 0.0) for _ in range(4)] == [
        [1.0, 6.0],
        [0.0, 4.0],
        [-1.0, 2.0],
        [-2.0, 0.0],
    ]


def test_it_knows_whether_the_joints_have_a_command_to_follow() -> None:
    g = guard()
    g.freeze("imu was never heard")
    assert not g.has_commanded
    command(g, 1.0, 8.0)
    g.stop("emergency stop")
    g.release()
    assert g.has_commanded


def test_a_freeze_may_end_by_itself_with_a_ramp() -> None:
    g = guard(ramp_steps=2, resume=True)
    command(g, 1.0, 8.0)
    assert g.freeze("late").tolist() == [0.0, 0.0]  # type: ignore[union-attr]
    assert command(g, 1.0, 8.0) == [0.5, 4.0]


@pytest.mark.parametrize(
    ("options", "held"),
    [({}, [0.0, 0.0]), ({"hold": True}, [1.0, 4.0]), ({"positions": True}, [1.0, 4.0])],
    ids=["efforts", "held efforts", "positions"],
)
def test_what_is_commanded_while_frozen(options: dict[str, bool], held: list[float]) -> None:
    g = guard(**options)
    moved(g, 1.0, 4.0)
    for _ in range(3):
        assert g.freeze("late").tolist() == held  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("options", "left"),
    [({"hold": True}, [0.0, 0.0]), ({"positions": True}, [1.0, 4.0])],
    ids=["efforts", "positions"],
)
def test_a_stop_lasts_until_it_is_released(options: dict[str, bool], left: list[float]) -> None:
    g = guard(resume=True, **options)
    moved(g, 1.0, 4.0)
    assert g.stop("emergency stop").tolist() == left  # type: ignore[union-attr]
    assert g.stop("another").tolist() == left  # type: ignore[union-attr]
    assert g.freeze("late").tolist() == left  # type: ignore[union-attr]
    assert moved(g, 1.0, 4.0) == left
    assert (g.state, g.reason) == (State.STOPPED, "emergency stop")
    g.release()
    moved(g, 1.0, 4.0)
    assert g.state is State.RUNNING


def test_positions_that_were_never_commanded_are_left_alone_by_a_stop() -> None:
    assert guard(positions=True).stop("emergency stop") is None


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_command_that_is_not_finite_stops(bad: float) -> None:
    g = guard(resume=True)
    command(g, 1.0, 4.0)
    assert command(g, 0.0, bad) == [0.0, 0.0]
    assert (g.state, g.reason) == (State.STOPPED, "the controller's command is not finite")


NUMBERS = st.floats(allow_nan=True, allow_infinity=True)
EVENTS = st.one_of(
    st.tuples(st.just("command"), st.tuples(NUMBERS, NUMBERS)),
    st.tuples(st.sampled_from(["freeze", "stop", "release"]), st.just(())),
)


@given(
    events=st.lists(EVENTS, max_size=30),
    steps=st.integers(0, 5),
    hold=st.booleans(),
    resume=st.booleans(),
)
def test_whatever_happens_efforts_are_finite_limited_and_slow_or_zero(
    events: list[Any], steps: int, hold: bool, resume: bool
) -> None:
    g = guard(ramp_steps=steps, hold=hold, resume=resume)
    last = np.zeros(2)
    for what, numbers in events:
        if what == "release":
            g.release()
            continue
        out = g.command(np.array(numbers)) if what == "command" else getattr(g, what)("why")
        if out is None:
            assert not g.has_commanded
            continue
        assert np.isfinite(out).all()
        assert (out >= LIMITS.low).all()
        assert (out <= LIMITS.high).all()
        if out.any():  # a stop or a freeze is at once
            assert (np.abs(out - last) <= LIMITS.step + 1e-12).all()
        last = out


def test_a_ramp_takes_whole_periods() -> None:
    assert [ramp_steps(s, 0.0165) for s in (0.0, 0.0165, 0.02, 0.33)] == [0, 1, 2, 20]
