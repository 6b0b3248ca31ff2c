"""Examples in docstrings return what they print."""

import doctest
import importlib
import pkgutil

import pytest

import beamdae

MODULES = [m.name for m in pkgutil.walk_packages(beamdae.__path__, "beamdae.")]
WITH_EXAMPLES = [
    name
    for name in MODULES
    if name != "beamdae.__main__"
    and any(t.examples for t in doctest.DocTestFinder().find(importlib.import_module(name)))
]


def test_some_docstrings_have_examples():
    assert len(WITH_EXAMPLES) >= 4


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_of_module_return_what_they_print(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    results = doctest.testmod(importlib.import_module(name))
    assert results.attempted
    assert results.failed == 0
