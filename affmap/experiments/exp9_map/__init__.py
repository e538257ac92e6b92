"""Experiment IX, a memorised map."""
