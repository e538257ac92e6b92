"""Experiment I, obstacle avoidance."""
