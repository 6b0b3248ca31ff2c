"""Settings of all tests."""

import os
import signal

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

# A first example builds and compiles kernels, which takes as long as the machine is slow. Each run
# draws examples of its own, and CI runs the tests several times.
settings.register_profile("beamdae", deadline=None, max_examples=25)
settings.load_profile("beamdae")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """What needs a browser runs with the slow tests: it takes longer to start than most to run."""
    for item in items:
        if "browser" in item.fixturenames:
            item.add_marker(pytest.mark.slow(reason="starts a browser"))
