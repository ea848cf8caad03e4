"""Keep every core awake at the lowest priority until the shell that started this has gone.

A virtual machine whose cores fall asleep may be given them back tenths of a second late; tests that live in real time
would see boats that are not steered for as long. Who has something to do gets the core at once, and all of it: a core
that others keep awake is left alone.
"""

from __future__ import annotations

import os
import time

YIELDS = 100
SHARED_S = 0.005
"""So many yields that take as long were given to somebody else."""
LEFT_ALONE_S = 0.1


def main() -> None:
    """Yield for ever, one process a core."""
    parent, first = os.getppid(), os.getpid()
    cores = sorted(os.sched_getaffinity(0))
    core = next((core for core in cores[1:] if os.fork() == 0), cores[0])
    if core != cores[0]:
        parent = first
    os.sched_setaffinity(0, {core})
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    while os.getppid() == parent:
        begun = time.monotonic()
        for _ in range(YIELDS):
            os.sched_yield()
        if time.monotonic() - begun > SHARED_S:
            time.sleep(LEFT_ALONE_S)


if __name__ == "__main__":
    main()
