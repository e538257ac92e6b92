"""Checked values: the base class of settings, the types of their values, and messages about wrong ones."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
