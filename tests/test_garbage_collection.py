"""Garbage collection during and after imports and the writing of pictures."""

import gc
import subprocess
import sys

import pytest

from beamdae.cli.output import WrittenFiles
from beamdae.garbage_collection import paused_collection

SCRIPT = """
import gc
import sys
import weakref

import beamdae as bd

assert gc.isenabled()
bd.Mechanism
bd.simulate
assert gc.isenabled()
n_exempt = gc.get_freeze_count()

class Node:
    pass

node = Node()
node.itself = node
node_of_cycle = weakref.ref(node)
del node
bd.Revolute, bd.modes
assert gc.get_freeze_count() <= n_exempt, "after the first run, results would not be collected"
gc.collect()
assert node_of_cycle() is None
print(n_exempt)
"""


@pytest.mark.slow(reason="starts two processes")
def test_modules_of_a_script_are_exempt_but_not_those_of_a_session(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    counts = [
        int(subprocess.run([sys.executable, *arguments], check=True, capture_output=True).stdout)
        for arguments in ((script,), ("-c", SCRIPT))
    ]
    assert counts[0] > 20_000
    assert counts[1] < 10_000  # Python's own


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
