"""Figures of Experiment IX."""
