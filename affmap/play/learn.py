"""The command `affmap-learn`: watch an agent learn online, in a window or as a film, while its map grows."""

from argparse import Namespace
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pygame
import torch

from affmap.cli.app import command
from affmap.cli.parser import Parser
from affmap.config.compose import check as config_of
from affmap.env.procedural import load
from affmap.env.rendering import open_window
from affmap.env.rules import Rules
from affmap.env.scene import Scene
from affmap.env.vehicle import RENDER_FPS
from affmap.learning.learners import Learners
from affmap.learning.settings import OFFLINE, OfflineLearning
from affmap.model.lookup import AffordanceMap
from affmap.model.palette import Palette
from affmap.pipeline.learn import beginners
from affmap.play.render import Frame, captioned, check, check_counts, write
from affmap.play.window import SCALE as WINDOW_SCALE
from affmap.play.window import find_screen
from affmap.settings import ConfigError, names, read

SPACING = 0.04
"""Spacing of the nodes of the displayed map, u."""


class Moment(NamedTuple):
    """A step of an agent that learns."""

    scene: Scene
    line: str
    """What is to be said of it."""


def moments(learners: Learners) -> Iterator[Moment]:
    """Let agents learn without end, and show each step of the first one.

    The ground has the colours of the affordance map of its first model, as it was when the round began. A round is
    flown and learned from before its first step is shown.
    """
    kind, news = learners.settings.kind, "knows nothing yet"
    while True:
        layout = learners.layout(learners.num_rounds)
        before = learners.num_rounds * learners.settings.round_steps
        ground = _ground(learners)
        losses = learners.round()
        flown = learners.rounds[0][-1]
        for step, action in enumerate(flown.action, start=1):
            here, past = flown.true_position[step], flown.true_position[: step + 1]
            goal = None if flown.goal is None else flown.goal[step - 1]
            scene = Scene(layout, learners.vehicle.radius, here, goal, action=action, past=past, ground=ground)
            yield Moment(scene, f"{kind}, step {before + step:,}: {news}")
        news = f"training loss of round {learners.num_rounds} was {losses[0]:.1f} nats".replace("-", "\N{MINUS SIGN}")


def _ground(learners: Learners) -> np.ndarray | None:
    """Colours of the map of the first model in the layout of the next round, `[Y, X, 3]`; None without a code."""
    first = learners.stack.select([0])
    if first.vision is None:
        return None
    codes = AffordanceMap.paint(first, [learners.layout(learners.num_rounds).map], SPACING).codes[0].numpy()
    return Palette.fit(codes.reshape(-1, codes.shape[-1]))(codes)


def learners_of(kind: str, world: str, context_size: int = 8, seed: int = 0) -> Learners:
    """One agent, a committee, that has learned nothing yet.

    Args:
        kind: the name of a file of `conf/learning`.
        world: the name of a layout.
        context_size: C.
        seed: of its first model.

    Raises:
        ConfigError: there is no such file; or it learns offline; or a value is not allowed.
    """
    if kind not in names("learning"):
        raise ConfigError(f"--learning {kind} does not exist; there are: {', '.join(_online())}.")
    if isinstance(load(world), Rules):
        raise ConfigError(f"--world {world} has rules for worlds, and agents learn in one; name a layout, such as fog.")
    members = read("learning", kind).get("committee", 1)
    values = {"world": world, "learning": kind, "model.context_size": context_size, "seed": seed, "members": members}
    config = config_of([f"{key}={value}" for key, value in values.items()])
    if isinstance(config.learning, OfflineLearning):
        raise ConfigError(f"--learning {kind} explores first and learns later; choose {', '.join(_online())}.")
    return beginners(config, config.learning)


def _online() -> list[str]:
    """Names of the files of `conf/learning` of agents that learn while they fly."""
    return [name for name in names("learning") if name != OFFLINE.kind]


def film(learners: Learners, steps: int) -> Iterator[Frame]:
    """Pictures of the first steps of an agent that learns, one for each."""
    for scene, line in islice(moments(learners), steps):
        yield captioned(scene, line)


def watch(learners: Learners) -> None:
    """Show an agent that learns in a window, until that is closed; the space bar is for pauses.

    Raises:
        ConfigError: there is no screen.
    """
    find_screen()
    clock, paused = pygame.time.Clock(), False
    for scene, line in moments(learners):
        picture = captioned(scene, line, WINDOW_SCALE)
        while True:
            screen = open_window(picture.shape[1::-1], "affmap-learn")
            for event in pygame.event.get():
                closing = event.type == pygame.KEYDOWN and event.key in (pygame.K_ESCAPE, pygame.K_q)
                if event.type == pygame.QUIT or closing:
                    pygame.display.quit()
                    return
                if event.type == pygame.KEYDOWN and event.key == pygame.K_SPACE:
                    paused = not paused
            pygame.surfarray.blit_array(screen, picture.transpose(1, 0, 2))
            pygame.display.flip()
            clock.tick(RENDER_FPS)
            if not paused:
                break


def main() -> None:
    """Run the command `affmap-learn`."""
    purpose = "watch an agent explore, learn from it at once, and its affordance map grow."
    examples = (
        "  affmap-learn\n  affmap-learn --world fog --learning deviation\n"
        "  affmap-learn --output learning.gif --steps 3000 --every 20"
    )
    parser = Parser("affmap-learn", purpose, examples)
    parser.add_argument("--world", default="original", help="a layout of conf/layout (default: original)")
    parser.add_argument("--learning", default="disagreement", help=f"{', '.join(_online())} (default: disagreement)")
    parser.add_argument("--context-size", type=int, default=8, help="units of the context code (default: 8)")
    parser.add_argument("--seed", type=int, default=0, help="of the first of its models (default: 0)")
    parser.add_argument("--output", type=Path, help="a .gif or .mp4 in place of a window")
    parser.add_argument("--steps", type=int, default=2000, help="length of a film (default: 2000)")
    parser.add_argument("--every", type=int, default=10, help="of a film: a frame every so many steps (default: 10)")
    given = parser.take()
    torch.set_num_threads(1)  # a step is many small operations; more threads wait for each other
    command(lambda _: _learn(given), resumes=False)


def _learn(given: Namespace) -> None:
    learners = learners_of(given.learning, given.world, given.context_size, given.seed)
    if given.output is None:
        watch(learners)
        return
    check(given.output)
    check_counts(given)
    write(given.output, film(learners, given.steps), given.every)
    print(f"The film is {given.output}")
