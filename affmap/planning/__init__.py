"""Planners: searches for the actions that minimise an objective. They know neither models nor the world."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
