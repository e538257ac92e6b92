"""The stages of a job, a file each: the keys that it depends on, the version of its rules, its work."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
