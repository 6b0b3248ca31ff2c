"""Settings of all tests, and the selection of slow ones."""

import gc
import os
import signal
from collections import defaultdict
from zlib import crc32

import pytest
from hypothesis import settings

# Set before numpy is imported: the workers of xdist already use all cores, so more threads of BLAS
# would slow them down.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# xdist sets the width of the terminal to 80 columns, which does not apply to its workers.
os.environ.pop("COLUMNS", None)

# Background jobs of a shell and their children ignore Ctrl-C, but the tests of Ctrl-C need the
# handler that a terminal sets.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# The same for a closed terminal, which processes started by nohup ignore.
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

# No deadline, because the first example compiles kernels. Examples are the same on all machines,
# so that a failure is caused by a change; `pytest --hypothesis-profile=explore` tries new ones.
settings.register_profile("beamdae", deadline=None, max_examples=25, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=25)
settings.load_profile("beamdae")

# Of fewer variants of a test, one is a default test and the others are slow ones. Of at least as
# many, one of these numbers is a default test, or at least a slow one; the others are left out.
_MANY_VARIANTS = 4
_VARIANTS_PER_DEFAULT_TEST = 16
_VARIANTS_PER_SLOW_TEST = 4
# One of this many slow tests is run in folders that a change did not touch.
_SLOW_PER_SAMPLE = 4
# Tests of models, external answers and the catalog leave out no variant.
_COMPLETE_FOLDERS = ("models", "properties", "validation")
_DOCTESTS = "test_docstrings.py"
# Runs check their results only if some filter may show the warnings, which are ignored. This one
# matches no message: slow tests thus check the results of every run, for errors in these checks.
_CHECKS_RESULTS = "always:(?!):beamdae.errors.BeamdaeWarning"
_WORKER = os.environ.get("PYTEST_XDIST_WORKER", "")  # of xdist, such as "gw1"
_COLLECTS_IN_REVERSE = _WORKER.endswith(("1", "3", "5", "7", "9"))


def pytest_addoption(parser):
    parser.addoption("--seed", default="", help="draw other variants of tests")
    parser.addoption("--sample", metavar="SEED", help="run a quarter of the slow tests, drawn ...")
    parser.addoption("--touched", default="", help="... and all of these folders ('beams cli')")


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Exempt modules and tests from garbage collections, which would search them again and again.

    The 14 000 tests, most of them not selected, would cost a tenth of the time of a run.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Let every other worker collect in reverse, so that workers share the bytecode of modules.

    Rewriting the assertions of all modules takes about ten seconds.
    """
    report = yield
    if _COLLECTS_IN_REVERSE and isinstance(collector, pytest.Directory):
        report.result.reverse()
    return report


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Mark tests in a browser and most variants of a test as slow, whose runs are checked."""
    if _WORKER:
        items.sort(key=lambda item: item.path.parts)
    tests = defaultdict(list)
    for item in items:
        tests[item.nodeid.partition("[")[0]].append(item)
    left_out = set()
    for name, variants in tests.items():
        if "browser" in variants[0].fixturenames:
            for item in variants:
                item.add_marker(pytest.mark.slow(reason="starts a browser"))
        elif variants[0].path.name != _DOCTESTS:
            left_out |= _mark_variants(name, variants, config.option.seed)
    sample, touched = config.option.sample, config.option.touched.split()
    for item in items:
        if item.get_closest_marker("slow"):
            item.add_marker(pytest.mark.filterwarnings(_CHECKS_RESULTS))
            is_sampled = sample is not None and item.path.parent.name not in touched
            # The last digits of this number are related to those that have chosen the variant.
            number = _draw(item.nodeid, sample) // _VARIANTS_PER_DEFAULT_TEST
            if is_sampled and number % _SLOW_PER_SAMPLE:
                left_out.add(item)
    # Whoever names a variant, or a word of its name, wants it.
    is_named = config.option.keyword or any("[" in argument for argument in config.args)
    if left_out and not is_named:
        items[:] = [item for item in items if item not in left_out]
        config.hook.pytest_deselected(items=list(left_out))


def _mark_variants(name, variants, seed):
    """Mark variants as slow and return those to be left out, drawn by the seed."""
    if len(variants) < _MANY_VARIANTS:
        fast = [item for item in variants if not item.get_closest_marker("slow")]
        default = _draw(name, seed) % max(len(fast), 1)
        for item in fast[:default] + fast[default + 1 :]:
            item.add_marker(pytest.mark.slow(reason="a further variant of a law"))
        return set()
    numbers = {item: _draw(item.nodeid, seed) for item in variants}
    # At least one variant is run, so that every law is tried.
    smallest = min(
        variants, key=lambda item: (numbers[item] % _VARIANTS_PER_SLOW_TEST, numbers[item])
    )
    for item, number in numbers.items():
        if number % _VARIANTS_PER_DEFAULT_TEST:
            item.add_marker(pytest.mark.slow(reason="one of many variants of a law"))
    if variants[0].path.parent.name in _COMPLETE_FOLDERS:
        return set()
    return {x for x in variants if numbers[x] % _VARIANTS_PER_SLOW_TEST and x is not smallest}


def _draw(name, seed):
    return crc32(f"{seed}{name}".encode())
