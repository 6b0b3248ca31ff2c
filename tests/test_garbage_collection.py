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


@pytest.mark.slow(reason="starts a process")
def test_objects_of_a_pause_are_not_searched_with_young_objects():
    """After the imports of a run, collections of young objects took 40 ms of every script."""
    code = """
import gc

from beamdae.garbage_collection import paused_collection

with paused_collection():
    objects = [[] for _ in range(10_000)]
n_young = len(gc.get_objects(generation=0)) + len(gc.get_objects(generation=1))
assert n_young < len(objects), n_young
assert not gc.get_freeze_count()
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_files_are_written_without_collections(tmp_path):
    files, states = WrittenFiles(), []
    files.write("picture", lambda: states.append(gc.isenabled()) or [tmp_path])
    assert states == [False]
    assert gc.isenabled()
