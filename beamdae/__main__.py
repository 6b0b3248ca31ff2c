"""`python -m beamdae`."""

from beamdae.cli import main

if __name__ == "__main__":
    main()
