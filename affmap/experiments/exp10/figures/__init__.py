"""Figures of Experiment X, rivals."""
