"""What is said about how punctual commands are."""

from __future__ import annotations

from pga_me_ros.hardware.timing import Timing


def test_latency_jitter_and_late_commands() -> None:
    timing = Timing(0.010)
    for sent in (0.000, 0.010, 0.021, 0.037):
        timing.add(sent - 0.002, sent)
    assert timing.values() == {
        "commands": "4",
        "latency median, 99 %, most (ms)": "2.00, 2.00, 2.00",
        "jitter median, 99 % (ms)": "1.00, 5.90",
        "late": "1",
    }
    assert timing.summary().startswith("4 commands; latency median, 99 %, most (ms) 2.00,")


def test_a_pause_is_no_interval() -> None:
    timing = Timing(0.010)
    timing.add(0.0, 0.0)
    timing.pause()
    timing.add(9.0, 9.0)
    assert (timing.count, timing.late) == (2, 0)


def test_without_commands_there_is_nothing_to_say_about_them() -> None:
    assert Timing(0.010).values()["jitter median, 99 % (ms)"] == "-, -"
