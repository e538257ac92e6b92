"""The stages of a job, a file each: the keys that it depends on, the version of its rules, its work."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
