"""Plots in Python: worlds, maps, flights, losses and metrics, Axes in and Axes out, drawn by the code of the reports.

Each function draws on `ax`, or on the Axes of a new figure in the style of the reports, and returns them. New figures
are pyplot's: notebooks show them, and scripts do by `plt.show()`. Settings of Matplotlib stay as they are.
"""

from affmap.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
