"""Models: vision model and transition model side by side for all members, look-ups of context codes, imagination."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
