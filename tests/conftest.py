"""Settings of all tests."""

import os
import signal
from collections import Counter
from zlib import crc32

import pytest
from hypothesis import settings

# Before numpy is imported: workers of xdist share the cores, threads of BLAS would fight for them.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Workers of xdist are told of a terminal with 80 columns, which is none of theirs.
os.environ.pop("COLUMNS", None)

# A shell's background job starts with Ctrl-C ignored, and its children with it: the tests of Ctrl-C
# need it as a terminal gives it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# A first example builds and compiles kernels, which takes as long as the machine is slow. The same
# examples on every machine: a change is judged by what it changes. New ones are looked for by
# `pytest --hypothesis-profile=explore`.
settings.register_profile("beamdae", deadline=None, max_examples=25, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=25)
settings.load_profile("beamdae")


# Of laws that hold for so many variants and more, every fourth is tried by default.
_MANY, _EVERY = 4, 4


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """What needs a browser, and most variants of laws with many, run with the slow tests."""
    laws = Counter(_law(item) for item in items)
    for item in items:
        if "browser" in item.fixturenames:
            # It takes longer to start than most tests to run.
            item.add_marker(pytest.mark.slow(reason="starts a browser"))
        # By a hash, so that each value of each parameter is there in some law or other.
        elif laws[_law(item)] >= _MANY and crc32(item.nodeid.encode()) % _EVERY:
            item.add_marker(pytest.mark.slow(reason="one of many variants of a law"))


def _law(item):
    return item.nodeid.partition("[")[0]
