"""Beliefs of models along recorded exploration that their training did not see, where reports are known.

A step in fog begins with a report; a model expects the next one, on average, where it believes to be after the step.
"""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from affmap.control.pretrained import read_members
from affmap.data.batches import DataModule
from affmap.data.collect import DATASET, Exploration, read_dataset
from affmap.results.files import KINDS, Floats
from affmap.results.setting import Setting
from affmap.results.tables import Results
from affmap.training.steps import classify_steps


class Tracks(NamedTuple):
    """Beliefs of M members after the N steps that begin and end in fog."""

    errors: Floats
    """`[M, N, 2]` believed minus true position after the step, u."""
    noise: Floats
    """`[N, 2]` reported minus true position before the step: noise of the last report, u."""
    untouched: NDArray[np.bool_]
    """`[N]`: has the vehicle touched nothing since it entered fog?"""

    @property
    def clear(self) -> "Tracks":
        """Those of steps since the entry into fog at which nothing was touched."""
        return Tracks(self.errors[:, self.untouched], self.noise[self.untouched], self.untouched[self.untouched])


def track(results: Results, setting: Setting) -> Tracks:
    """Track the vehicle in the validation sequences of a setting, with all its members."""
    data = setting.data[0]
    config = results.provenance[data]["config"]
    exploration, path = Exploration.model_validate(config["data"]), data / DATASET
    whole = exploration.num_sequences * len(config["training_layouts"])
    batches = DataModule(path, exploration, batch_size=whole, chunk_length=exploration.num_steps)
    ((batch,),) = batches.val_dataloader()
    arrays = {name: values[batches.validation] for name, values in read_dataset(path).items() if name != "view"}
    reported, true, touching = arrays["position"], arrays["true_position"], arrays["touching"]
    inside = classify_steps(path, batches.validation) == KINDS.index("inside")
    changes = []
    for folder in setting.train:
        trained = results.provenance[folder]["config"]
        members = range(trained["seed"], trained["seed"] + trained["members"])
        stack, _ = read_members(folder.parent, folder.name, [folder.name], members)
        with torch.inference_mode():
            carry = stack.transition.initial(len(reported))
            _, prediction = stack.transition.unroll(carry, stack.encode(batch.views), batch.delta, batch.action)
        changes.append(prediction.mean.numpy())
    believed = reported[:, :-1] + np.concatenate(changes)
    untouched = _untouched(reported != true, touching)
    return Tracks((believed - true[:, 1:])[:, inside], (reported - true)[:, :-1][inside], untouched[inside])


def _untouched(is_noisy: NDArray[np.bool_], touching: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether nothing was touched since the vehicle entered fog, at the end of each step: `[S, T]`.

    Args:
        is_noisy: `[S, T + 1, 2]`, whether coordinates are reported with noise.
        touching: `[S, T]`, whether a surface is touched at the end of the step.
    """
    in_fog = np.asarray(is_noisy.any(-1))
    untouched = np.zeros(touching.shape, bool)
    since = np.ones(len(touching), bool)
    for step, touched in enumerate(touching.T):
        since = (since | ~in_fog[:, step]) & ~touched
        untouched[:, step] = since
    return untouched
