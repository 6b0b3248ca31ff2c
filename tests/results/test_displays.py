"""Figures and animations of results are drawn by `beamdae.views`."""

import subprocess
import sys

import pytest

from beamdae import views
from beamdae.results.displays import Views, load_views


def test_views_define_every_function_that_results_call():
    assert load_views() is views
    assert set(Views.__annotations__) == set(views.__all__)
    assert all(callable(getattr(views, name)) for name in views.__all__)


@pytest.mark.slow(reason="starts a process")
def test_results_import_no_drawing_code():
    script = (
        "import sys, beamdae.results.solution\n"
        "print([name for name in sys.modules if 'report' in name])"
    )
    command = [sys.executable, "-c", script]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
