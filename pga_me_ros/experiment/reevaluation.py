"""The step after a run has reached its budget: its best controllers are re-evaluated, for the fitness difference.

A separate process that ends, with its workers, when the experiment that started it is gone.
"""

from __future__ import annotations

import os
import signal
import threading

from pga_me_ros.reevaluate.__main__ import main


def _end_with_input() -> None:
    """Wait until the other end of standard input is closed, which the kernel does however the parent process dies."""
    while os.read(0, 4096):
        pass
    os.killpg(os.getpgrp(), signal.SIGKILL)


if __name__ == "__main__":
    # Needed if the parent ignores it, as shells do for background jobs.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if os.getpgrp() == os.getpid():  # otherwise the group has other members
        threading.Thread(target=_end_with_input, daemon=True).start()
    raise SystemExit(main())
