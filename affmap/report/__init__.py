"""Reports: a writer for all kinds, and the report of an experiment with its figures, pages and players."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
