"""Hide the packages named in the environment variable HIDDEN; "threads" forbids new threads.

Python imports this module at its start if this folder is in PYTHONPATH, also in worker processes.
"""

import os
from importlib.machinery import PathFinder

HIDDEN = set(os.environ.get("HIDDEN", "").split(","))

find_spec, find_distributions = PathFinder.find_spec, PathFinder.find_distributions


def find_visible_spec(name, path=None, target=None):
    if name.partition(".")[0] in HIDDEN:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return find_spec(name, path, target)


def find_visible_distributions(*context):
    return (x for x in find_distributions(*context) if x.name not in HIDDEN)


def refuse_thread(*_, **__):
    raise RuntimeError("can't start new thread")


PathFinder.find_spec = find_visible_spec
PathFinder.find_distributions = find_visible_distributions
if "threads" in HIDDEN:
    import threading

    threading._start_new_thread = refuse_thread
