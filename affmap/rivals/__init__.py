"""Rivals: policies without a model, from imitation or reinforcement, on the sensations that the agents have."""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
