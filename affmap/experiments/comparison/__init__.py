"""Comparisons: the values of one key, everything else being equal."""
