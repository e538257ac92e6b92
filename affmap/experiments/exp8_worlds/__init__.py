"""Experiment VIII in the four worlds of Experiment V."""
