"""Drawing functions: they take data and Axes and return the Axes."""
