"""Entry point of `python -m beamdae` and of the command `beamdae`."""

import os
import sys

_INTERRUPTED = 130  # exit code after Ctrl-C: 128 plus the number of SIGINT


# Address space that commands need beyond that of Python [bytes]; a short run needs 0.7e9. With
# less, BLAS ends the process or waits forever, and modules cannot be imported.
_MIN_ADDRESS_SPACE = 0.75e9
_USAGE_ERROR = 2


def _require_address_space() -> None:
    """Exit with a message if `ulimit -v` leaves less than 0.75 GB of free address space."""
    try:
        from resource import RLIM_INFINITY, RLIMIT_AS, getrlimit

        limit = getrlimit(RLIMIT_AS)[0]
        with open("/proc/self/statm") as file:
            used = int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (ImportError, OSError, ValueError):
        return
    if limit != RLIM_INFINITY and limit - used < _MIN_ADDRESS_SPACE:
        required = (used + _MIN_ADDRESS_SPACE) / 1e9
        message = (
            f"error: beamdae needs {required:.2g} GB of address space, but the limit is "
            f"{limit / 1e9:.2g} GB; increase the limit (ulimit -v).\n"
        )
        if sys.stderr is not None:
            sys.stderr.write(message)
        sys.exit(_USAGE_ERROR)


def main() -> None:
    """Run the command line; Ctrl-C during the import ends the process without a traceback."""
    # Runs use one thread. By default, NumPy and SciPy each start one thread per core, which delays
    # the start of the process.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        _require_address_space()
        from beamdae.cli import signals, startup

        signals.install_handlers()
        startup.begin_startup()
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)
    try:
        from beamdae.cli.app import main as run
    except KeyboardInterrupt:
        signals.ignore_signals()
        sys.exit(signals.exit_code())
    startup.exit_without_teardown(run())


if __name__ == "__main__":
    main()
