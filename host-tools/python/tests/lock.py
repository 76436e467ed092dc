"""Whether a call gives Python's lock back while it works: told by the order of events, not by time."""

import sys
import threading
import time

#: As long as a call is repeated until another thread has come to its turn.
PATIENCE_S = 60

# Nobody is asked to hand the lock over: it changes hands only where it is given back.
sys.setswitchinterval(1e6)


class _Turns(threading.Thread):
    def __init__(self):
        super().__init__(daemon=True)
        self.count = 0
        self.is_over = False

    def run(self):
        while not self.is_over:
            self.count += 1
            time.sleep(1e-4)


def comes_another_thread(work, patience_s=PATIENCE_S):
    """Whether another thread comes to a turn while `work`, one call into the extension, runs; and what
    this returns."""
    turns = _Turns()
    turns.start()
    while turns.count == 0:
        time.sleep(1e-4)
    until = time.monotonic() + patience_s
    try:
        while True:
            before = turns.count
            result = work()
            if turns.count > before:
                return True, result
            if time.monotonic() > until:
                return False, result
    finally:
        turns.is_over = True
        turns.join()


def beside_another_thread(work):
    """What `work` returns; other threads must come to their turns meanwhile."""
    comes, result = comes_another_thread(work)
    assert comes, "the lock was kept"
    return result
