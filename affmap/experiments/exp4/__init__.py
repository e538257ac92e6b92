"""Experiment IV, uncertainty avoidance."""
