"""Figures of keys and doors."""
