"""`python -m beamdae`, and the command `beamdae`."""

import sys


def main() -> None:
    """Run the command line; Ctrl-C is heard while it is being imported as well."""
    try:
        from beamdae.cli.commands import main as run
    except KeyboardInterrupt:
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
