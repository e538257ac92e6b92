"""Data sets: exploration of the training layouts, and its sequences as batches for training."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
