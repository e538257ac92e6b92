"""Flights to watch: in a window, and as films."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
