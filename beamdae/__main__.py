"""`python -m beamdae`."""

from beamdae.cli.commands import main

if __name__ == "__main__":
    main()
