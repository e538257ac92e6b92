"""Experiment VIII with goals from the very beginning."""
