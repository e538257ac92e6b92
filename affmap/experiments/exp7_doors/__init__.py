"""Experiment VII, keys and doors."""
