"""Experiment II, generalization."""
