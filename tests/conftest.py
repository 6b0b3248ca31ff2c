"""Settings of all tests."""

from hypothesis import settings

# A first example builds and compiles kernels, which takes as long as the machine is slow.
settings.register_profile("beamdae", deadline=None)
settings.load_profile("beamdae")
