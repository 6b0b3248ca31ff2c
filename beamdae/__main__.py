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
        from beamdae.cli import signals

        signals.install_handlers()
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)
    try:
        from beamdae.cli.app import main as run
    except KeyboardInterrupt:
        signals.ignore_signals()
        sys.exit(signals.exit_code())
    run()


if __name__ == "__main__":
    # Python puts the working folder first; a model file there called numpy.py would hide NumPy.
    if not sys.flags.safe_path and sys.path[0] != os.path.dirname(os.path.dirname(__file__)):
        del sys.path[0]
    main()
