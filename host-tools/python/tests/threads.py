"""While something takes long, another thread of Python goes on."""

import glob
import threading

import plumbline

trials = sorted(glob.glob("trials/*"))


def turns_of_another_thread(work):
    """How often another thread comes to its turn while `work` is one call into the extension."""
    done = threading.Event()
    turns = 0

    def run():
        work()
        done.set()

    thread = threading.Thread(target=run)
    thread.start()
    while not done.is_set():
        turns += 1
        # Hands the lock over at once; where it is never given back, this comes back once.
        done.wait(1e-4)
    thread.join()
    return turns


for work in (
    lambda: plumbline._plumbline.figures(trials),
    lambda: plumbline._plumbline.study("study.toml"),
    lambda: plumbline._plumbline.open_trial(trials[0]),
):
    turns = turns_of_another_thread(work)
    assert turns >= 5, turns
