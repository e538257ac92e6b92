"""Experiment X, rivals."""
