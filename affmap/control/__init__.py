"""Control: agents that plan at every step, many side by side or one in a loop of its own; trained agents."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
