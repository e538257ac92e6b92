"""Results on disk: folders that are whole or not there, named by all that they depend on."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
