"""Runs to be played in the page."""
