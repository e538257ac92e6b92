"""Experiment V, disentanglement."""
