"""A command line as checked jobs: composed by Hydra, typed, expanded. Opens no store."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
