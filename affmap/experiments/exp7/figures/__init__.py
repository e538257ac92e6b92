"""Figures of Experiment VII."""
