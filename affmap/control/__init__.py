"""Control: agents that plan at every step, many side by side or one in a loop of its own; trained agents."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
