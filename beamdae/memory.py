"""How much memory there is, told before it is asked for."""

from __future__ import annotations

import os
from pathlib import Path

from beamdae.errors import BeamdaeError

_BYTES_PER_GIGABYTE = 1e9
# Address space, which such limits are about, over memory in use: 2.8 in a run of 10 000 elements.
# SuperLU breaks down with the process where it is short.
_ADDRESS_SPACE_RATIO = 2.5


def available_memory() -> float:
    """Memory [bytes] this process can still get; infinite where the system does not tell.

    What other processes leave of the machine's, and what a limit (`ulimit -v`) leaves.
    """
    return min(_free_physical_memory(), _free_address_space())


def _free_physical_memory() -> float:
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        kilobytes = next(line.split()[1] for line in lines if line.startswith("MemAvailable"))
        return 1024.0 * float(kilobytes)
    except (OSError, StopIteration):
        pass
    try:
        # Of what is in use nothing is known here.
        return float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return float("inf")


def _free_address_space() -> float:
    try:
        from resource import RLIM_INFINITY, RLIMIT_AS, getrlimit

        limit = getrlimit(RLIMIT_AS)[0]
        if limit == RLIM_INFINITY:
            return float("inf")
        pages = float(Path("/proc/self/statm").read_text().split()[0])
        return max(limit - pages * os.sysconf("SC_PAGE_SIZE"), 0.0) / _ADDRESS_SPACE_RATIO
    except (ImportError, OSError, ValueError):
        return float("inf")


def require_memory(part: str, what: str, needed: float, remedy: str) -> None:
    """Refuse what needs more memory [bytes] than there is.

    Raises
    ------
    BeamdaeError
        With what is needed, what there is, and what helps.
    """
    there = available_memory()
    if needed > there:
        raise BeamdaeError(
            f"{part}: {what} needs about {format_gigabytes(needed)} of memory, {format_gigabytes(there)} are "
            f"left; {remedy}."
        )


def format_gigabytes(size: float) -> str:
    """A size [bytes] to be read."""
    return f"{size / _BYTES_PER_GIGABYTE:.2g} GB"
