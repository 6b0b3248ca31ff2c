"""The examples in docstrings give what they say."""

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


def test_there_are_examples():
    assert len(WITH_EXAMPLES) >= 4


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    failed, tried = doctest.testmod(importlib.import_module(name))
    assert tried
    assert failed == 0
