"""Garbage collection during imports and the writing of pictures."""

import gc
import subprocess
import sys

import pytest

from beamdae.cli.output import WrittenFiles
from beamdae.garbage_collection import paused_collection

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


@pytest.mark.parametrize("was_enabled", [True, False])
def test_collection_is_paused_and_restored(was_enabled):
    (gc.enable if was_enabled else gc.disable)()
    try:
        with paused_collection():
            assert not gc.isenabled()
        assert gc.isenabled() is was_enabled
    finally:
        gc.enable()


def test_files_are_written_without_collections(tmp_path):
    files, states = WrittenFiles(), []
    files.write("picture", lambda: states.append(gc.isenabled()) or [tmp_path])
    assert states == [False]
    assert gc.isenabled()
