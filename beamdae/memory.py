"""Memory that this process can still allocate."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path

from beamdae.errors import BeamdaeError

_BYTES_PER_GIGABYTE = 1e9
_BYTES_PER_KILOBYTE = 1024.0
# Ratio of address space, to which limits apply, to memory in use, measured in a run of 10 000
# elements. A smaller value would admit runs that exceed the limit, at which SuperLU crashes the
# process.
_ADDRESS_SPACE_RATIO = 2.8
_MEMORY_FILE = Path("/proc/meminfo")
_PAGES_FILE = Path("/proc/self/statm")
_GROUP_FILE = Path("/proc/self/cgroup")
_GROUPS = Path("/sys/fs/cgroup")
# Files with limit and use, and the entry of memory.stat for cached files, in versions 2 and 1.
_GROUP_ENTRIES = {
    "": ("memory.max", "memory.current", "inactive_file"),
    "memory": ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
}
# Enough for all entries of interest; `Path.read_text` takes four times as long.
_MAX_FILE_BYTES = 4096
UNCHECKED_BYTES = 1e6  # see `require_memory`
# In messages of CasADi, and of the dynamic linker.
_OUT_OF_MEMORY_WORDS = ("bad_alloc", "failed to map segment", "cannot allocate memory")


def available_memory() -> float:
    """Return the memory [bytes] that this process can still allocate; infinite if unknown.

    The result is the smallest of the free memory of the machine (the total memory on systems
    without /proc/meminfo), that of the container or control group, and, if `ulimit -v` sets a
    limit, the unused address space divided by 2.8.
    """
    return min(_free_physical_memory(), _free_address_space(), _free_group_memory())


def _free_physical_memory() -> float:
    try:
        lines = _read_start(_MEMORY_FILE).splitlines()
        kilobytes = next(line.split()[1] for line in lines if line.startswith("MemAvailable"))
        return _BYTES_PER_KILOBYTE * float(kilobytes)
    except (OSError, StopIteration):
        pass
    try:
        # Total memory: systems without /proc/meminfo do not report how much is in use.
        return float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return float("inf")


def _free_group_memory() -> float:
    """Return the memory [bytes] below the limits of this process's control group and its parents.

    Files that the system caches count as free.
    """
    free = float("inf")
    with suppress(OSError, ValueError):
        for line in _read_start(_GROUP_FILE).splitlines():
            _, controllers, name = line.split(":", 2)
            if controllers not in ("", "memory"):
                continue
            root = _GROUPS / controllers
            limit, used, cache = _GROUP_ENTRIES[controllers]
            # In a container, its own group is the root, whatever its name outside is.
            for group in (root / name.lstrip("/"), *(root / name.lstrip("/")).parents):
                if not group.is_relative_to(root):
                    break
                with suppress(OSError, ValueError):
                    entries = dict(
                        x.split() for x in _read_start(group / "memory.stat").splitlines()
                    )
                    unused = float(_read_start(group / limit)) - float(_read_start(group / used))
                    free = min(free, max(unused + float(entries.get(cache, 0.0)), 0.0))
    return free


def _free_address_space() -> float:
    try:
        from resource import RLIM_INFINITY, RLIMIT_AS, getrlimit

        limit = getrlimit(RLIMIT_AS)[0]
        if limit == RLIM_INFINITY:
            return float("inf")
        pages = float(_read_start(_PAGES_FILE).split()[0])
        return max(limit - pages * os.sysconf("SC_PAGE_SIZE"), 0.0) / _ADDRESS_SPACE_RATIO
    except (ImportError, OSError, ValueError):
        return float("inf")


def require_memory(part: str, purpose: str, required: float, remedy: str) -> None:
    """Raise BeamdaeError unless `required` bytes of memory are available.

    The message contains `purpose`, the required and the available memory, and `remedy`. Less than
    1 MB is not checked: reading the available memory takes 3 % of the assembly of a small model.
    """
    if required < UNCHECKED_BYTES:
        return
    available = available_memory()
    if required > available:
        raise BeamdaeError(
            f"{part}: {purpose} needs about {format_gigabytes(required)} of memory, "
            f"but only {format_gigabytes(available)} is available; {remedy}."
        )


def is_out_of_memory(exception: BaseException) -> bool:
    """Return True if the exception, or one of its causes, was raised for lack of memory.

    Besides MemoryError, errors of CasADi, the dynamic linker and the operating system are
    recognized.
    """
    cause: BaseException | None = exception
    while cause is not None:
        is_from_system = isinstance(cause, OSError) and cause.errno == errno.ENOMEM
        if isinstance(cause, MemoryError) or is_from_system:
            return True
        if isinstance(cause, (RuntimeError, ImportError, OSError)) and any(
            words in str(cause) for words in _OUT_OF_MEMORY_WORDS
        ):
            return True
        cause = cause.__cause__
    return False


def format_gigabytes(size: float) -> str:
    """Return a size [bytes] as text in gigabytes (1e9 bytes), with two significant digits."""
    return f"{size / _BYTES_PER_GIGABYTE:.2g} GB"


def _read_start(file: Path) -> str:
    with open(file, "rb", buffering=0) as content:
        return content.read(_MAX_FILE_BYTES).decode()
