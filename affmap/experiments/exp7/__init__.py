"""Experiment VII, beyond the horizon."""
