"""Experiment X, twelve factors of variation."""
