"""beamdae: curved beams in flexible multibody systems, on SUNDIALS IDA and generalized-alpha.

`__init__.pyi` lists the public names; each is imported when it is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = "0.1.0"
