"""Figures of Experiment X, twelve factors of variation."""
