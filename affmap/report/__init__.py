"""Reports: a writer for all kinds, and the report of an experiment with its figures, pages and players."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
