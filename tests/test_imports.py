"""Imports between the files of the package, besides the layers that `lint-imports` checks."""

from graphlib import TopologicalSorter

import pytest


def test_no_files_import_each_other():
    """Imports within functions and for type checks count, those by `deferred` do not."""
    grimp = pytest.importorskip("grimp")
    graph = grimp.build_graph("beamdae", cache_dir=None)
    imports = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    TopologicalSorter(imports).prepare()
