"""The command `affmap-render`: flights of trained agents as a film, a picture for each kind of model, side by side."""

import argparse
import os
from collections.abc import Iterable, Iterator, Sequence
from importlib.util import find_spec
from itertools import islice, product
from pathlib import Path
from typing import Any

import numpy as np
import pygame
import torch

from affmap.cli.app import command
from affmap.control.arguments import vehicle
from affmap.control.controller import Controller
from affmap.control.episodes import bring, fly
from affmap.control.mpc import PlanningAgent
from affmap.control.pretrained import load, origin
from affmap.control.settings import GUIDES
from affmap.control.time_to_go import TimeToGo
from affmap.env.layout import Layout
from affmap.env.procedural import first_layout
from affmap.env.rendering import BLACK, WHITE, Canvas
from affmap.env.scene import Scene
from affmap.env.vehicle import RENDER_FPS
from affmap.model.lookup import AffordanceMap
from affmap.model.palette import Palette
from affmap.model.stack import Stack
from affmap.play.parser import TRANSITIONS, Parser
from affmap.results.files import Trajectories
from affmap.settings import ConfigError, missing

SCALE, HEAD, GAP = 160, 26, 8  # pixels: a unit, the line above a picture, between pictures
SPACING = 0.02
"""Spacing of the nodes of the displayed map, u."""

Frame = np.ndarray
"""`[height, width, 3]` uint8."""


def film(
    source: str | Path,
    context_sizes: Sequence[int] | None = None,
    transitions: Sequence[str | None] = (None,),
    *,
    layout: str | None = None,
    planner: str | None = None,
    guide: str | None = None,
    member: int | None = None,
    run: int = 0,
    num_steps: int | None = None,
    with_map: bool = True,
) -> Iterator[Frame]:
    """Film flights with the same start and goal, one frame per step.

    Args:
        source: source of the models, see `affmap.load`.
        context_sizes: one picture for each; by default the smallest and the largest of the models.
        transitions: one picture for each of these transition models, of each context size; None for the first there is.
        layout: name of the world, by default that of the experiment; for rules of worlds, the member's first world.
        planner: name of a file of `conf/planner`, by default that of the experiment.
        guide: none or time_to_go, of which the way is shown, too; by default that of the experiment.
        member: the member that flies, by default the first of the experiment.
        run: 0 to 3, the corner of the start.
        num_steps: length of the flights, by default that of the experiment's runs.
        with_map: whether the ground has the colours of the affordance map, once doors are open that without them.

    Raises:
        ConfigError: there are no such models, world, planner or guide.
    """
    models = origin(source)
    sizes = sorted({*models.context_sizes[:1], *models.context_sizes[-1:]}) if context_sizes is None else context_sizes
    films = []
    for context_size, transition in product(sizes, transitions):
        members = None if member is None else [member]
        agent = load(source, context_size=context_size, transition=transition, members=members, planner=planner)
        first = first_layout(layout or models.layout, agent.seeds[0])
        if guide is not None:
            agent.settings = agent.settings.model_copy(update={"guide": guide})
        paths = Trajectories(**fly(agent, first, steps=num_steps).trajectories)
        grounds = _grounds(agent.stack, first) if with_map and context_size else {}
        title = f"context code of {context_size}" if context_size else "no context code"
        title = f"{transition}, C = {context_size}" if transition else title
        scenes = [paths.scene(run, step, first, vehicle(agent).radius) for step in range(paths.action.shape[1])]
        near = agent.settings.goal_radius
        scenes = [scene._replace(goal_radius=near, ground=grounds.get(scene.layout)) for scene in scenes]
        goal = paths.goal[run]
        films.append(_pictures(_with_ways(scenes, bring(agent, first), first, goal), title, goal))
    for pictures in zip(*films, strict=True):
        gap = np.full((len(pictures[0]), GAP, 3), 255, np.uint8)
        row = [part for picture in pictures for part in (picture, gap)]
        yield np.concatenate(row[:-1], axis=1)


def _grounds(stack: Stack, layout: Layout) -> dict[Layout, np.ndarray]:
    """Colours of the affordance maps of a layout and, where it has doors, of the opened one: `[Y, X, 3]` each."""
    worlds = dict.fromkeys([layout, layout.opened])
    codes = [AffordanceMap.paint(stack, [world.map], SPACING).codes[0].numpy() for world in worlds]
    palette = Palette.fit(np.concatenate([each.reshape(-1, each.shape[-1]) for each in codes]))
    return {world: palette(each) for world, each in zip(worlds, codes, strict=True)}


def _with_ways(scenes: Sequence[Scene], agent: Controller, layout: Layout, goal: np.ndarray) -> Iterator[Scene]:
    """Scenes of a flight that began in a layout, with the ways and times of the map that guides the agent, if any."""
    if not isinstance(agent, PlanningAgent) or agent.settings.guide == "none":
        yield from scenes
        return
    made = TimeToGo.imagine(agent, goal)
    maps = {layout: made, layout.opened: made.opened or made}
    times = {world: each.lines() for world, each in maps.items()}
    for scene in scenes:
        yield scene._replace(way=maps[scene.layout].paths(scene.position)[0], times=times[scene.layout])


def _pictures(scenes: Iterable[Scene], title: str, goal: np.ndarray) -> Iterator[Frame]:
    """Frames of a flight to a goal."""
    for step, scene in enumerate(scenes):
        distance = float(np.hypot(*(scene.position - goal)))
        yield captioned(scene, f"{title}: step {step}, {distance:.2f} u to the goal")


def captioned(scene: Scene, text: str, scale: int = SCALE) -> Frame:
    """The picture of a moment, with a line above it.

    Args:
        scene: the moment.
        text: of the line.
        scale: pixels a unit.
    """
    pygame.font.init()
    canvas = Canvas(scene.layout.size, window=False, pixels_per_unit=scale)
    canvas.draw(scene)
    line = pygame.font.Font(None, HEAD).render(text, True, BLACK)
    head = pygame.Surface((canvas.surface.get_width(), HEAD))
    head.fill(WHITE)
    head.blit(line, (2, 3))
    return np.concatenate([pygame.surfarray.array3d(head).transpose(1, 0, 2), canvas.array()])


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


def check_counts(arguments: argparse.Namespace) -> None:
    """Check the flags that count steps.

    Raises:
        ConfigError: one is below 1.
    """
    for key in ("steps", "every"):
        if getattr(arguments, key) is not None and getattr(arguments, key) < 1:
            raise ConfigError(f"--{key} {getattr(arguments, key)} should be 1 or more.")


def main() -> None:
    """Run the command `affmap-render`."""
    purpose = "film trained agents that fly from a corner to the opposite one, side by side."
    examples = (
        "  affmap-render\n  affmap-render exp1 --world two_obstacles --context-size 8\n  affmap-render runs/exp1\n"
        "  affmap-render exp6 --world pairs_and_triples --transition mlp split\n"
        "  affmap-render exp5 --world trap --context-size 8 --guide time_to_go --steps 400"
    )
    parser = Parser("affmap-render", purpose, examples)
    parser.add_argument(
        "--context-size",
        type=int,
        nargs="+",
        help="units of codes, side by side (default: the fewest and the most there are)",
    )
    parser.add_argument(
        "--transition",
        nargs="+",
        default=[None],
        help=f"transition models, {TRANSITIONS}, side by side (default: the first there is)",
    )
    parser.add_argument("--planner", help="cem or gradient (default: that of the experiment)")
    parser.add_argument("--guide", choices=GUIDES, help="sub-goals on the way (default: that of the experiment)")
    parser.add_argument("--member", type=int, help="which of the models (default: the first)")
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
    check_counts(arguments)
    frames = film(
        arguments.source,
        arguments.context_size,
        arguments.transition,
        layout=arguments.world,
        planner=arguments.planner,
        guide=arguments.guide,
        member=arguments.member,
        run=arguments.run,
        num_steps=arguments.steps,
        with_map=not arguments.plain,
    )
    write(arguments.output, frames, arguments.every)
    print(f"The film is {arguments.output}")
