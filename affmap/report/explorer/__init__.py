"""Affordance maps to be pointed at in the page."""
