"""Entry point of `python -m beamdae` and of the command `beamdae`."""

import os
import sys

_INTERRUPTED = 130  # exit code after Ctrl-C: 128 plus the number of SIGINT


def main() -> None:
    """Run the command line; Ctrl-C during the import ends the process without a traceback."""
    # Runs use one thread. By default, NumPy and SciPy each start one thread per core, which delays
    # the start of the process.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from beamdae.cli import process

        process.install_handlers()
        process.begin_startup()
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)
    try:
        from beamdae.cli.app import main as run
    except KeyboardInterrupt:
        process.ignore_signals()
        sys.exit(process.exit_code())
    process.exit_without_teardown(run())


if __name__ == "__main__":
    main()
