"""Searches: trials, the best of them, and each value beside the result."""
