"""View -> context code with a cache, so that each distinct view is encoded once.

Imagined positions are all different, but their views recur: a world of Experiment I has some ten thousand.
"""

import torch
from torch import Tensor
from torch.nn.functional import embedding

from affmap.model.stack import Stack, num_changes
from affmap.model.windows import take_apart, words


class CachedEncoder:
    """Vision model with a cache: views recur, and each distinct view is encoded only once.

    Views are compared on the CPU, wherever the codes are.

    Attributes:
        limit: number of different views after which it forgets all and begins anew, as it does when weights change.
    """

    limit = 2**18

    def __init__(self, stack: Stack) -> None:
        """Encode views with `stack`."""
        self._stack = stack
        self._forget()

    def _forget(self) -> None:
        self._numbers: dict[bytes, int] = {}
        self._codes = next(self._stack.parameters()).new_empty(len(self._stack.seeds), 0, self._stack.context_size)
        self._changes = num_changes(self._stack.parameters())

    @torch.no_grad()
    def __call__(self, views: Tensor) -> Tensor:
        """Encode `views` `[M, ..., K, 11, 11]` bool, own views for each member: `[M, ..., C]`.

        Raises:
            TypeError: the views are not boolean.
            ValueError: not as many as there are members.
        """
        if len(views) != len(self._stack.seeds):
            raise ValueError(f"views have leading axis {len(views)}; it must be {len(self._stack.seeds)}, the members.")
        if len(self._numbers) > self.limit or self._changes != num_changes(self._stack.parameters()):
            self._forget()
        try:
            numbers = self._number(views)
            self._encode_new(views.reshape(-1, *views.shape[-3:]), numbers.flatten())
        except BaseException:  # numbered, but not encoded
            self._forget()
            raise
        rows = torch.arange(len(views), device=views.device) * self._codes.shape[1]
        return embedding(numbers + rows.view(-1, *[1] * (numbers.ndim - 1)), self._codes.flatten(0, 1))

    def _number(self, views: Tensor) -> Tensor:
        """Indices of views, in order of first appearance: `[...]` int64."""
        keys = words(views.flatten(-3)).flatten(0, -2).cpu().numpy()
        keys = keys.view(f"V{keys.itemsize * keys.shape[1]}")[:, 0].tolist()  # bytes
        numbers = self._numbers
        ids = [numbers.setdefault(key, len(numbers)) for key in keys]
        return torch.tensor(ids, device=views.device).view(views.shape[:-3])

    def _encode_new(self, views: Tensor, numbers: Tensor) -> None:
        """Encode those of `views` `[P, K, 11, 11]` whose `numbers` `[P]` have no codes yet."""
        num_known = self._codes.shape[1]
        if len(self._numbers) == num_known:
            return
        (places,) = (numbers >= num_known).nonzero(as_tuple=True)
        first = places.new_empty(len(self._numbers) - num_known).scatter_(0, numbers[places] - num_known, places)
        self._codes = torch.cat([self._codes, self._stack.encode(take_apart(views[first][None]))], dim=1)
