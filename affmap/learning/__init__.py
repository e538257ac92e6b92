"""Learning online: agents that choose their own experience, and learn from it at once."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
