"""`python -m beamdae`."""

import sys
from pathlib import Path

if __name__ == "__main__":
    # Python puts the working folder in front: a model there called numpy.py would hide the module.
    if not sys.flags.safe_path and Path(sys.path[0]) != Path(__file__).parents[1]:
        del sys.path[0]
    from beamdae.cli.commands import main

    main()
