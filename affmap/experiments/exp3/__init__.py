"""Experiment III, behavioral relevance of affordance codes."""
