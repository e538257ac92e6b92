"""Experiment VIII, learning by oneself."""
