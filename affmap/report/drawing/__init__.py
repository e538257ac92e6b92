"""Drawing functions: data and Axes in, Axes out."""
