"""Results on disk: folders that are whole or not there, named by all that they depend on."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
