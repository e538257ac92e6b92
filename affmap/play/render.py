"""The command `affmap-render`: flights of trained agents as a film, one picture for each context size, side by side."""

import argparse
import os
from collections.abc import Iterable, Iterator, Sequence
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pygame
import torch

from affmap.cli.app import command
from affmap.control.arguments import vehicle
from affmap.control.episodes import fly
from affmap.control.pretrained import load, origin
from affmap.env.procedural import first_layout
from affmap.env.rendering import BLACK, WHITE, Canvas
from affmap.env.scene import Scene
from affmap.env.vehicle import RENDER_FPS
from affmap.model.lookup import AffordanceMap
from affmap.model.palette import Palette
from affmap.play.parser import Parser
from affmap.results.files import Trajectories
from affmap.settings import ConfigError, missing

SCALE, HEAD, GAP = 160, 26, 8  # pixels: a unit, the line above a picture, between pictures
SPACING = 0.02
"""Spacing of the nodes of the displayed map, u."""

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
    """Film flights with the same start and goal, one frame per step.

    Args:
        source: source of the models, see `affmap.load`.
        context_sizes: one picture for each.
        layout: name of the world, by default that of the experiment; for rules of worlds, the member's first world.
        planner: name of a file of `conf/planner`, by default that of the experiment.
        member: the member that flies.
        run: 0 to 3, the corner of the start.
        num_steps: length of the flights, by default that of the experiment's runs.
        with_map: whether the ground has the colours of the affordance map.

    Raises:
        ConfigError: there are no such models, world or planner.
    """
    first = first_layout(layout or origin(source).layout, member)
    films = []
    for context_size in context_sizes:
        agent = load(source, context_size=context_size, members=[member], planner=planner)
        paths = Trajectories(**fly(agent, first, steps=num_steps).trajectories)
        extras: dict[str, Any] = {"goal_radius": agent.settings.goal_radius}
        if with_map and context_size:
            codes = AffordanceMap.paint(agent.stack, [first.map], SPACING).codes[0].numpy()
            extras["ground"] = Palette.fit(codes.reshape(-1, context_size))(codes)
        title = f"context code of {context_size}" if context_size else "no context code"
        scenes = [paths.scene(run, step, first, vehicle(agent).radius) for step in range(paths.action.shape[1])]
        films.append(_pictures([scene._replace(**extras) for scene in scenes], title))
    for pictures in zip(*films, strict=True):
        gap = np.full((len(pictures[0]), GAP, 3), 255, np.uint8)
        row = [part for picture in pictures for part in (picture, gap)]
        yield np.concatenate(row[:-1], axis=1)


def _pictures(scenes: Iterable[Scene], title: str) -> Iterator[Frame]:
    """Frames of a flight, with a line above each."""
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
    """Write every n-th frame in real time, as an animated GIF or, if the name ends in .mp4, as a video."""
    import imageio.v3 as imageio

    pictures = list(islice(frames, 0, None, every))
    how: dict[str, Any] = {"duration": 1000 * every / RENDER_FPS, "loop": 0, "subrectangles": True}
    if path.suffix != ".gif":
        how = {"fps": RENDER_FPS / every, "macro_block_size": 2}
    imageio.imwrite(path, pictures, **how)


def check(path: Path) -> None:
    """Check that a film can be written before any flight.

    Raises:
        ConfigError: it cannot.
    """
    if path.suffix not in (".gif", ".mp4"):
        raise ConfigError(f"--output {path} should end in .gif or .mp4.")
    if path.suffix == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise ConfigError(f"{missing(f'--output {path}', 'video')}; .gif needs none.")
    path.parent.mkdir(parents=True, exist_ok=True)
    if not os.access(path.parent, os.W_OK):
        raise ConfigError(f"--output {path}: nothing can be written there.")


def main() -> None:
    """Run the command `affmap-render`."""
    purpose = "film trained agents that fly from a corner to the opposite one, side by side."
    examples = "  affmap-render\n  affmap-render exp1 --world two_obstacles --context-size 8\n  affmap-render runs/exp1"
    parser = Parser("affmap-render", purpose, examples)
    parser.add_argument(
        "--context-size",
        type=int,
        nargs="+",
        default=[0, 8],
        help="units of codes, side by side (default: 0 8)",
    )
    parser.add_argument("--planner", help="cem or gradient (default: that of the experiment)")
    parser.add_argument("--member", type=int, default=0, help="which of the models (default: 0)")
    parser.add_argument("--run", type=int, default=0, choices=range(4), help="the corner to start in (default: 0)")
    parser.add_argument("--steps", type=int, help="how long it flies (default: as the experiment's runs, 200)")
    parser.add_argument("--every", type=int, default=2, help="leave out frames: one every so many steps (default: 2)")
    parser.add_argument("--plain", action="store_true", help="circles instead of the affordance map")
    parser.add_argument("--output", type=Path, default=Path("flight.gif"), help="a .gif or .mp4 (default: flight.gif)")
    arguments = parser.take()
    torch.set_num_threads(1)  # a step is many small operations; more threads wait for each other
    command(lambda _: _render(arguments), resumes=False)


def _render(arguments: argparse.Namespace) -> None:
    check(arguments.output)
    for key in ("steps", "every"):
        if getattr(arguments, key) is not None and getattr(arguments, key) < 1:
            raise ConfigError(f"--{key} {getattr(arguments, key)} should be 1 or more.")
    frames = film(
        arguments.source,
        arguments.context_size,
        layout=arguments.world,
        planner=arguments.planner,
        member=arguments.member,
        run=arguments.run,
        num_steps=arguments.steps,
        with_map=not arguments.plain,
    )
    write(arguments.output, frames, arguments.every)
    print(f"The film is {arguments.output}")
