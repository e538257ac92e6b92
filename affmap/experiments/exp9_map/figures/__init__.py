"""Figures of Experiment IX, a memorised map."""
