"""Check that a run costs about the same with an empty cache, and does not import numba.

    venv/bin/python .ci/check_first_use.py

`venv` must contain the wheel. Without its objects, the first run compiles and the check fails.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile

# Of processor times, which vary by a tenth.
_MAX_RATIO = 1.3
_ROUNDS = 3
_PROGRAM = """
import sys
from beamdae.__main__ import main
sys.argv = ["beamdae", "run", "example:hub_beam", "--quiet"]
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
assert "numba" not in sys.modules, "numba was imported"
"""


def run_seconds(cache: str) -> float:
    """Return the processor time of a run with this cache folder."""
    with tempfile.TemporaryDirectory() as folder:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, "-c", _PROGRAM],
            cwd=folder,
            env={**os.environ, "XDG_CACHE_HOME": cache},
            check=True,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Compare the first and second runs of several new caches."""
    times = []
    for _ in range(_ROUNDS):
        with tempfile.TemporaryDirectory() as cache:
            times.append((run_seconds(cache), run_seconds(cache)))
    first, second = (min(column) for column in zip(*times, strict=True))
    print(f"first use: {first:.2f} s of processor time, second: {second:.2f} s")
    if first > _MAX_RATIO * second:
        sys.exit(f"the first use takes over {_MAX_RATIO} times as long as the second")


if __name__ == "__main__":
    main()
