"""Trials for worker processes, in a module that imports quickly."""

import os
import time


def run_trial(name):
    """Die, exit or hang if the name says so; otherwise return the name."""
    if name == "dies":
        os.kill(os.getpid(), 9)
    if name == "exits":
        os._exit(0)
    if name == "hangs":
        time.sleep(100.0)
    return name
