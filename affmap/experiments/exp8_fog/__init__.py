"""Experiment VIII in fog."""
