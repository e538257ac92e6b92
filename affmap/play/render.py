"""The command `affmap-render`: flights of trained agents as a film, one picture for each context size, side by side."""

import argparse
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pygame
import torch

from affmap.cli.app import command
from affmap.control.episodes import fly
from affmap.control.pretrained import experiments, load, origin
from affmap.env.body import Vehicle
from affmap.env.procedural import first_layout
from affmap.env.rendering import BLACK, WHITE, Canvas
from affmap.env.scene import Scene
from affmap.env.vehicle import RENDER_FPS
from affmap.model.lookup import AffordanceMap
from affmap.model.palette import Palette
from affmap.results.files import Trajectories
from affmap.settings import ConfigError

SCALE, HEAD, GAP = 160, 26, 8  # pixels: a unit, the line above a picture, between pictures
SPACING = 0.02
"""Between nodes of the map that is shown, u."""

Frame = np.ndarray
"""`[height, width, 3]` uint8."""


def film(
    source: str | Path,
    context_sizes: Sequence[int],
    *,
    layout: str | None = None,
    planner: str | None = None,
    member: int = 0,
    run: int = 0,
    num_steps: int | None = None,
    with_map: bool = True,
) -> Iterator[Frame]:
    """Fly, and show each step; flights begin in the same place and have the same goal.

    Args:
        source: whose models; see `affmap.load`.
        context_sizes: one picture for each.
        layout: name of the world, by default that of the experiment; of rules for worlds the member's first.
        planner: name of a file of `conf/planner`, by default that of the experiment.
        member: which of the models.
        run: 0 to 3, the corner where it starts.
        num_steps: how long it flies, by default as long as the experiment's runs.
        with_map: whether the ground has the colours of the affordance map.

    Raises:
        ConfigError: there are no such models, world or planner.
    """
    flown, radius = first_layout(layout or origin(source).layout, member), Vehicle.load("vehicle", "default").radius
    films = []
    for context_size in context_sizes:
        agent = load(source, context_size=context_size, members=[member], planner=planner)
        if num_steps:
            agent.settings = agent.settings.model_copy(update={"num_steps": num_steps})
        paths = Trajectories(**fly(agent, flown).trajectories)
        shown: dict[str, Any] = {"goal_radius": agent.settings.goal_radius}
        if with_map and context_size:
            codes = AffordanceMap.paint(agent.stack, [flown.map], SPACING).codes[0].numpy()
            shown["ground"] = Palette.fit(codes.reshape(-1, context_size))(codes)
        title = f"context code of {context_size}" if context_size else "no context code"
        scenes = [paths.scene(run, step, flown, radius) for step in range(paths.action.shape[1])]
        films.append(_pictures([scene._replace(**shown) for scene in scenes], title))
    for pictures in zip(*films, strict=True):
        gap = np.full((len(pictures[0]), GAP, 3), 255, np.uint8)
        row = [part for picture in pictures for part in (picture, gap)]
        yield np.concatenate(row[:-1], axis=1)


def _pictures(scenes: Iterable[Scene], title: str) -> Iterator[Frame]:
    """One flight, with a line above each picture."""
    pygame.font.init()
    font = pygame.font.Font(None, HEAD)
    for step, scene in enumerate(scenes):
        canvas = Canvas(scene.layout.size, window=False, pixels_per_unit=SCALE)
        canvas.draw(scene)
        distance = float(np.hypot(*(scene.position - scene.goal)))
        line = font.render(f"{title}: step {step}, {distance:.2f} u to the goal", True, BLACK)
        head = pygame.Surface((canvas.surface.get_width(), HEAD))
        head.fill(WHITE)
        head.blit(line, (2, 3))
        yield np.concatenate([pygame.surfarray.array3d(head).transpose(1, 0, 2), canvas.array()])


def write(path: Path, frames: Iterator[Frame], every: int) -> None:
    """Write every so manieth frame, at the speed of the world: an animated GIF or, where the name ends so, a video."""
    import imageio.v3 as imageio

    chosen = list(islice(frames, 0, None, every))
    how: dict[str, Any] = {"duration": 1000 * every / RENDER_FPS, "loop": 0, "subrectangles": True}
    if path.suffix != ".gif":
        how = {"fps": RENDER_FPS / every, "macro_block_size": 2}
    imageio.imwrite(path, chosen, **how)


def check(path: Path) -> None:
    """Make sure that a film can be written, before anything flies.

    Raises:
        ConfigError: it cannot.
    """
    if path.suffix not in (".gif", ".mp4"):
        raise ConfigError(f"--output {path} should end in .gif or .mp4.")
    if path.suffix == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise ConfigError(
            f"--output {path}: videos need the extra [video], pip install 'affmap[video]'; .gif does not."
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    if not os.access(path.parent, os.W_OK):
        raise ConfigError(f"--output {path}: nothing can be written there.")


def main() -> None:
    """`affmap-render`: a film of trained agents that fly from a corner to the opposite one."""
    parser = argparse.ArgumentParser(prog="affmap-render", description=main.__doc__)
    known = ", ".join(experiments())
    parser.add_argument(
        "source", nargs="?", default="exp1", help=f"a report's folder, or one of {known} (default: exp1)"
    )
    parser.add_argument("--context-size", type=int, nargs="+", default=[0, 8], help="side by side (default: 0 8)")
    parser.add_argument("--layout", help="a file of conf/layout (default: that of the experiment)")
    parser.add_argument("--planner", help="cem or gradient (default: that of the experiment)")
    parser.add_argument("--member", type=int, default=0, help="which of the models (default: 0)")
    parser.add_argument("--run", type=int, default=0, choices=range(4), help="the corner to start in (default: 0)")
    parser.add_argument("--steps", type=int, help="how long it flies (default: as the experiment's runs, 200)")
    parser.add_argument("--every", type=int, default=2, help="leave out frames: one every so many steps (default: 2)")
    parser.add_argument("--plain", action="store_true", help="circles instead of the affordance map")
    parser.add_argument("--output", type=Path, default=Path("flight.gif"), help="a .gif or .mp4 (default: flight.gif)")
    chosen = parser.parse_args()
    sys.argv[1:] = []
    torch.set_num_threads(1)  # a step is many small operations; more threads wait for each other
    command(lambda _: _render(chosen), resumes=False)


def _render(chosen: argparse.Namespace) -> None:
    check(chosen.output)
    for key in ("steps", "every"):
        if getattr(chosen, key) is not None and getattr(chosen, key) < 1:
            raise ConfigError(f"--{key} {getattr(chosen, key)} should be 1 or more.")
    frames = film(
        chosen.source,
        chosen.context_size,
        layout=chosen.layout,
        planner=chosen.planner,
        member=chosen.member,
        run=chosen.run,
        num_steps=chosen.steps,
        with_map=not chosen.plain,
    )
    write(chosen.output, frames, chosen.every)
    print(f"The film is {chosen.output}")
