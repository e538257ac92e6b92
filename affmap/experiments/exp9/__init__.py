"""Experiment IX, through the fog."""
