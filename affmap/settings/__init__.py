"""Checked values: the base class of settings, the types of their values, and messages about wrong ones."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
