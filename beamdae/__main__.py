"""`python -m beamdae`, and the command `beamdae`."""

import os
import sys


def main() -> None:
    """Run the command line; an interrupt is heard while it is being imported as well."""
    # Runs use one thread; NumPy and SciPy would start one a core each, which takes a tenth of one.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    code = 130
    try:
        from beamdae.cli import signals

        signals.install_handlers()
        code = 0
        from beamdae.cli.app import main as run
    except KeyboardInterrupt:
        if not code:
            signals.ignore_signals()
        sys.exit(code or signals.exit_code())
    run()


if __name__ == "__main__":
    # Python puts the working folder in front: a model there called numpy.py would hide the module.
    if not sys.flags.safe_path and sys.path[0] != os.path.dirname(os.path.dirname(__file__)):
        del sys.path[0]
    main()
