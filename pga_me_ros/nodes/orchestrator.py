"""Orchestrator: starts, watches and stops the other nodes, and leads a run from start to end."""

from __future__ import annotations

import signal
import sys

import rclpy
from rclpy.signals import SignalHandlerOptions

from pga_me_ros.core.settings import Settings
from pga_me_ros.orchestration.control import Control
from pga_me_ros.orchestration.lead import lead_until_told, spinning
from pga_me_ros.process.signals import Signals, insist
from pga_me_ros.process.streams import let_go
from pga_me_ros.ros.command_line import Program, start
from pga_me_ros.ros.options import RunOptions
from pga_me_ros.ros.process import report

PROGRAM = Program(
    "orchestrator",
    "Grows a repertoire by PGA-MAP-Elites: starts the other nodes, leads the run and serves what it found. "
    "The same command resumes a run that was stopped.",
    (Settings, RunOptions),
)


def main() -> int:
    """Run the orchestrator."""
    try:
        if not start(PROGRAM, signal_handler_options=SignalHandlerOptions.NO):
            return 0
        control = Control()
        # The first signal stops the run, the second ends everything at once, further ones have no effect.
        signals = Signals(lambda _: control.stop_requested.set(), insist)
        with spinning(control) as faults:
            code = lead_until_told(control, signals)
        return faults[0] if faults else code
    except KeyboardInterrupt:
        return 0
    except BrokenPipeError:  # the reader of our output has exited, as in `| head`
        let_go(sys.stdout)
        return 128 + signal.SIGPIPE
    except Exception as error:
        return report(error)
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    raise SystemExit(main())
