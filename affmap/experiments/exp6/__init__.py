"""Experiment VI, codes that compose."""
