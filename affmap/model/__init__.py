"""Models: vision model and transition model side by side for all members, look-ups of context codes, imagination."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
