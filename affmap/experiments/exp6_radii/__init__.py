"""Experiment VI once more, with circles of several radii in training."""
