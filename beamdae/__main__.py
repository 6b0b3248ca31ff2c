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
