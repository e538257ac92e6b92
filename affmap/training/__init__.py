"""Training of a stack of members with Lightning."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
