"""Memory available to this process, compared with a requirement before it is allocated."""

from __future__ import annotations

import os
from pathlib import Path

from beamdae.errors import BeamdaeError

_BYTES_PER_GIGABYTE = 1e9
_BYTES_PER_KILOBYTE = 1024.0
# Address space, which limits apply to, over memory in use: 2.8 in a run of 10 000 elements. SuperLU
# crashes the process where address space runs out.
_ADDRESS_SPACE_RATIO = 2.5


def available_memory() -> float:
    """Return the memory [bytes] this process can still get; infinite if the system does not say.

    It is the smaller one of the free memory of the machine and what a limit (`ulimit -v`) leaves.
    """
    return min(_free_physical_memory(), _free_address_space())


def _free_physical_memory() -> float:
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        kilobytes = next(line.split()[1] for line in lines if line.startswith("MemAvailable"))
        return _BYTES_PER_KILOBYTE * float(kilobytes)
    except (OSError, StopIteration):
        pass
    try:
        # Total memory: these systems do not tell how much is in use.
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


def require_memory(part: str, purpose: str, required: float, remedy: str) -> None:
    """Require that `required` bytes of memory are available.

    Raises
    ------
    BeamdaeError
        With the required and the available memory, and the remedy.
    """
    available = available_memory()
    if required > available:
        raise BeamdaeError(
            f"{part}: {purpose} needs about {format_gigabytes(required)} of memory, "
            f"{format_gigabytes(available)} are left; {remedy}."
        )


def format_gigabytes(size: float) -> str:
    """Return a size [bytes] as text, in gigabytes."""
    return f"{size / _BYTES_PER_GIGABYTE:.2g} GB"
