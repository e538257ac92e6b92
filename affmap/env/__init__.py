"""The simulation: layouts, physics, and the vehicle as Gymnasium environments."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
