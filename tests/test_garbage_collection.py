"""Garbage collection during imports."""

import subprocess
import sys

import pytest

SCRIPT = """
import gc

n_exempt = gc.get_freeze_count()
import beamdae as bd

bd.simulate
assert gc.isenabled()
assert gc.get_freeze_count() <= n_exempt, "garbage of the caller would not be collected"
"""


@pytest.mark.slow(reason="starts a process")
def test_imports_leave_the_garbage_collector_as_it_is(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    subprocess.run([sys.executable, script], check=True)
