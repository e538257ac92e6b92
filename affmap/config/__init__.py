"""A command line as checked jobs: composed by Hydra, typed, expanded. Opens no store."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
