"""Code of a user: a package with a planner, a transition model, two terrains; a module with an agent and a metric."""

from pathlib import Path

PACKAGE, VERSION = "garden", "1.2"
"""The package, which is installed."""

GARDEN = '''
"""A planner, a transition model and two terrains."""

from typing import Literal

import numpy as np

import affmap
from affmap.settings import Count, Settings


@affmap.register_planner
class Shooting(Settings):
    kind: Literal["shooting"]
    horizon: Count
    num_iterations: Count
    num_candidates: Count

    def initial(self, num_problems, device="cpu"):
        return None

    def plan(self, objective, state, generators):
        import torch
        from affmap.planning.planner import Plan, evaluate

        shape = (self.num_iterations * self.num_candidates, self.horizon, 4)
        actions = torch.from_numpy(np.stack([each.random(shape, np.float32) for each in generators]))
        cost, best = evaluate(objective, actions).min(dim=1)
        return Plan(actions[torch.arange(len(best)), best], cost), None


@affmap.register_transition
class WideSettings(Settings):
    kind: Literal["wide"]
    factor: Count

    def make(self, generators, context_size, hidden_size, delta_scale):
        from affmap.model.transition import MLP

        return MLP(generators, context_size, self.factor * hidden_size, delta_scale)


def whirl(offset, velocity):
    return 0.5 * np.stack([-offset[..., 1], offset[..., 0]], axis=-1) - 0.1 * velocity


affmap.register_effect("wind", affmap.Effect("blows to the left", "#c994c7", (-1.0, 0.0)))
affmap.register_effect("whirl", affmap.Effect("whirls", "#e6c27a", force=whirl))
'''

NOTES = '''
"""An agent and a metric."""

from typing import Literal

import numpy as np

import affmap
from affmap.settings import Settings


@affmap.register_agent
class Still(Settings):
    kind: Literal["still"]

    def initial(self, num_problems):
        return None

    def act(self, observation, state, generators):
        from affmap.control import Decision

        return Decision.without_prediction(observation.position.new_zeros(len(observation.position), 4)), None


def path_length(paths):
    return np.linalg.norm(np.diff(paths.position, axis=1), axis=-1).sum(axis=1)


affmap.register_metric("path_length", affmap.Metric("path length", "u", "length of the path (u)", path_length))
'''

FILES = {
    "planner/shooting.yaml": "kind: shooting\nhorizon: 5\nnum_iterations: 3\nnum_candidates: 8\n",
    "model/transition/wide.yaml": "kind: wide\nfactor: 2\n",
    "agent/still.yaml": "kind: still\n",
    "layout/breezy.yaml": """
name: breezy
size: [3.0, 2.0]
channels: [wind, whirl]
border_channel: wind
start_margin: 0.1
start_side: 0.2
circles:
  - {center: [0.9, 1.0], radius: 0.4, effect: wind, channel: wind}
  - {center: [2.1, 1.0], radius: 0.4, effect: whirl, channel: whirl}
""",
}


def write(folder: Path) -> Path:
    """Write the module `notes`, and the files that choose all things, as into a user's folder; returns it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "notes.py").write_text(NOTES)
    for name, text in FILES.items():
        path = folder / "conf" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def install(folder: Path) -> None:
    """Write the package as pip installs it, with an entry point, into a `folder` on the path of modules."""
    information = folder / f"{PACKAGE}-{VERSION}.dist-info"
    information.mkdir(parents=True)
    (folder / f"{PACKAGE}.py").write_text(GARDEN)
    (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {PACKAGE}\nVersion: {VERSION}\n")
    (information / "entry_points.txt").write_text(f"[affmap]\nthings = {PACKAGE}\n")
