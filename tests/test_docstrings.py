"""Public names: catalog, docstrings and imports."""

import doctest
import importlib
import inspect
import linecache
import pkgutil
from graphlib import TopologicalSorter
from operator import attrgetter
from pathlib import Path

import pytest
from sample_parts import SAMPLES

import beamdae
import beamdae as bd
from beamdae import catalog


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
SLOW = pytest.mark.slow(reason="a quarter of a second and more")


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


# Public names are defined where the catalog says, and generated files agree with it.

PACKAGE = Path(bd.__file__).parent


@pytest.mark.parametrize("package", ["", *catalog.PACKAGES])
def test_type_stubs_are_up_to_date(package):
    stub = PACKAGE / package / "__init__.pyi"
    assert stub.read_text() == catalog.stub_text(package), "run `python beamdae/catalog.py`"


@pytest.mark.parametrize("public", catalog.NAMES.values(), ids=lambda public: public.name)
def test_public_name_is_defined_in_its_module(public):
    value = attrgetter(public.path)(bd)
    assert getattr(value, "__module__", public.module).startswith(public.module)


def test_every_public_name_is_listed_once_in_the_reference():
    names = [public.name for group in catalog.GROUPS for public in group.names]
    assert sorted(names) == sorted(set(names))
    packages = [getattr(bd, name) for name in catalog.PACKAGES]
    public = [*bd.__all__, *(name for package in packages for name in package.__all__)]
    assert sorted([*names, *catalog.PACKAGES]) == sorted(public)
    assert {group.page for group in catalog.GROUPS} == set(catalog.PAGES)


def test_sample_calls_belong_to_public_names_in_the_order_of_the_catalog():
    assert list(SAMPLES) == [name for name in catalog.NAMES if name in SAMPLES]


def test_integrators_of_the_command_line_are_integrators():
    assert len(catalog.INTEGRATORS) >= 4
    for public in catalog.INTEGRATORS.values():
        assert issubclass(getattr(bd, public.name), bd.Integrator)


# Imports between the files of the package, besides the layers that `lint-imports` checks.


def test_no_files_import_each_other():
    """Imports within functions and for type checks count, those by `deferred` do not."""
    grimp = pytest.importorskip("grimp")
    graph = grimp.build_graph("beamdae", cache_dir=None)
    imports = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    TopologicalSorter(imports).prepare()
