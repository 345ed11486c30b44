"""What follows when a run has grown: its best controllers are evaluated again, for the fitness difference.

A process of its own that ends, with its workers, when the experiment that started it is gone.
"""

from __future__ import annotations

import os
import signal
import threading

from pga_me_ros.reevaluate.__main__ import main


def _end_with_input() -> None:
    """Wait until the other end of standard input is closed, which the kernel does however its process dies."""
    while os.read(0, 4096):
        pass
    os.killpg(os.getpgrp(), signal.SIGKILL)


if __name__ == "__main__":
    # Also where whoever started us ignores it, as shells do for what runs in the background.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if os.getpgrp() == os.getpid():  # else the group is not ours to end
        threading.Thread(target=_end_with_input, daemon=True).start()
    raise SystemExit(main())
