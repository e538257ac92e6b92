"""Planners: searches for the actions that minimise an objective. They know neither models nor the world."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
