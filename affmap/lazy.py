"""Libraries that take a second or more to import, imported on first use: settings are checked without them (leaf).

Nothing in `sys.modules` before: NumPy's and SciPy's users look there for torch, and would import it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import torch as torch
    from scipy import stats as stats
else:

    class _Library:
        """Has the attributes of a module, which is imported when the first of them is asked for."""

        def __init__(self, name: str) -> None:
            self._name = name

        def __getattr__(self, attribute: str) -> Any:
            value = getattr(import_module(self._name), attribute)
            setattr(self, attribute, value)  # found without this method from now on
            return value

    torch, stats = _Library("torch"), _Library("scipy.stats")
