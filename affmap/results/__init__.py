"""Results: files of stages, tables, metrics, tests of claims, manifests of reports. Draws nothing."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
