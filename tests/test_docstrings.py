"""Examples in docstrings return what they print."""

import doctest
import importlib
import inspect
import linecache
import pkgutil

import pytest

import beamdae


class Finder(doctest.DocTestFinder):
    """Finder that also searches decorated functions, whose globals are those of the decorator."""

    def _from_module(self, module, object):
        return super()._from_module(module, inspect.unwrap(object))


MODULES = pkgutil.walk_packages(beamdae.__path__, "beamdae.")
# Modules without a prompt are not searched, because the search inspects each of their names.
WITH_EXAMPLES = [
    module.name
    for module in MODULES
    if ">>>" in inspect.getsource(importlib.import_module(module.name))
]


def test_some_docstrings_have_examples():
    assert len(WITH_EXAMPLES) >= 4


# Examples that trace equilibrium paths, and searches and sweeps of many runs.
SLOW_EXAMPLES = (
    "beamdae.analysis.fit.fit",
    "beamdae.analysis.optimization.optimize",
    "beamdae.analysis.statics.boundary",
    "beamdae.analysis.statics.imperfections",
    "beamdae.studies.sweeps.sweep",
)
SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=[SLOW] * (x in SLOW_EXAMPLES)) for x in WITH_EXAMPLES]
)
def test_examples_of_module_return_what_they_print(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # The debugger of each docstring would check all source files for changes.
    monkeypatch.setattr(linecache, "checkcache", lambda *_: None)
    runner = doctest.DocTestRunner()
    for test in Finder().find(importlib.import_module(name)):
        runner.run(test)
    results = runner.summarize()
    assert results.attempted
    assert results.failed == 0
