"""Rules for random layouts: an arena, and a draw of circles."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from affmap.env.layout import Arena, Layout
from affmap.lazy import notebook


class Rules(Arena):
    """Rules for random layouts; `draw` makes one."""

    @abstractmethod
    def draw(self, rng: np.random.Generator) -> Layout:
        """Draw a layout that obeys every rule.

        Raises:
            ValueError: none was found.
        """

    def _repr_html_(self) -> str | None:
        return notebook.rules(self)
