"""Figures of Experiment VI."""
