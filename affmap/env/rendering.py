"""Pictures of the vehicle in its world (pygame): arena, circles, goal, throttles, paths.

Knows geometry only; physics, agents and episodes are elsewhere.
"""

from typing import NamedTuple

import numpy as np
import pygame

from affmap.env.body import JET, NUM_DEVIATIONS, THROTTLES, Vehicle
from affmap.env.effects import EFFECTS
from affmap.env.layout import Layout

PIXELS_PER_UNIT = 200

WHITE, BLACK = (255, 255, 255), (0, 0, 0)
VEHICLE, THROTTLE, GOAL, PLAN = (0, 140, 70), (30, 90, 220), (220, 40, 40), (30, 30, 30)
PAST, CANDIDATE, UNCERTAIN = (0, 140, 70), (150, 150, 150), (120, 80, 160)


class Scene(NamedTuple):
    """A moment in a world; lengths in u."""

    layout: Layout
    position: np.ndarray
    """`[2]`, of the vehicle."""
    action: np.ndarray
    """`[4]`, opening of the throttles."""
    goal: np.ndarray
    """`[2]`"""
    goal_radius: float
    path: np.ndarray | None = None
    """`[H, 2]`, planned positions."""
    std: np.ndarray | None = None
    """`[H, 2]`, their standard deviations; circles have `NUM_DEVIATIONS` times their mean as radius."""
    candidates: np.ndarray | None = None
    """`[N, H, 2]`, other paths that were thought of."""
    past: np.ndarray | None = None
    """`[T, 2]`, where the vehicle has been."""
    ground: np.ndarray | None = None
    """`[Y, X, 3]` in [0, 1], colours of the ground; row 0 is y = 0."""


class Canvas:
    """A picture of a world, drawn anew each time; rows go downward, as pictures do."""

    def __init__(
        self, size: tuple[float, float], vehicle: Vehicle, window: bool, pixels_per_unit: int = PIXELS_PER_UNIT
    ) -> None:
        """Prepare pictures of arenas of `size` (u); with `window`, `show` puts them on the screen."""
        self._height, self._vehicle, self._scale = size[1], vehicle, pixels_per_unit
        width, height = (round(length * pixels_per_unit) for length in size)
        self.surface = pygame.Surface((width, height))
        self._window: pygame.Surface | None = None
        if window:
            pygame.display.init()
            pygame.display.set_caption("affmap")
            self._window = pygame.display.set_mode((width, height))
            self._clock = pygame.time.Clock()

    def draw(self, scene: Scene) -> None:
        """Draw everything once."""
        if scene.ground is None:
            self.surface.fill(WHITE)
            self._circles(scene.layout, filled=True)
        else:
            self._ground(scene.ground)
            self._circles(scene.layout, filled=False)
        pygame.draw.rect(self.surface, BLACK, self.surface.get_rect(), width=2)
        self._disc(GOAL, scene.goal, scene.goal_radius, width=2)
        self._disc(GOAL, scene.goal, 0.02)
        self._paths(scene)
        for direction, opening in zip(THROTTLES, scene.action, strict=True):
            # The jet leaves on the side opposite to where it pushes.
            rim = scene.position - direction * self._vehicle.radius
            end = rim - direction * JET * opening
            width = max(1, round(0.025 * self._scale))
            pygame.draw.line(self.surface, THROTTLE, self._pixel(rim), self._pixel(end), width)
        self._disc(VEHICLE, scene.position, self._vehicle.radius)

    def array(self) -> np.ndarray:
        """The picture, `[height, width, 3]` uint8."""
        return np.transpose(pygame.surfarray.array3d(self.surface), (1, 0, 2)).copy()

    def show(self, frames_per_second: int) -> None:
        """Put the picture on the screen and wait for its time to pass."""
        if self._window is not None:
            self._window.blit(self.surface, (0, 0))
            pygame.event.pump()
            pygame.display.flip()
            self._clock.tick(frames_per_second)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            pygame.display.quit()
            self._window = None

    def _ground(self, colors: np.ndarray) -> None:
        pixels = (255 * colors[::-1]).round().astype(np.uint8).transpose(1, 0, 2)  # columns first, from the top
        pygame.transform.smoothscale(pygame.surfarray.make_surface(pixels), self.surface.get_size(), self.surface)

    def _circles(self, layout: Layout, filled: bool) -> None:
        """The circles of the world, the highest last; their rims only, where the ground is to be seen."""
        layers = list(EFFECTS)
        for circle in sorted(layout.circles, key=lambda circle: layers.index(circle.effect)):
            color, center = EFFECTS[circle.effect].color, np.array(circle.center)
            if not filled:
                self._disc(WHITE, center, circle.radius, width=4)
            self._disc(color, center, circle.radius, width=0 if filled else 2)

    def _paths(self, scene: Scene) -> None:
        for candidate in () if scene.candidates is None else scene.candidates:
            self._line(CANDIDATE, np.vstack([scene.position, candidate]))
        if scene.past is not None:
            self._line(PAST, np.vstack([scene.past, scene.position]), width=2)
        if scene.path is not None:
            if scene.std is not None:
                for point, std in zip(scene.path, scene.std, strict=True):
                    self._disc(UNCERTAIN, point, NUM_DEVIATIONS * float(std.mean()), width=1)
            self._line(PLAN, np.vstack([scene.position, scene.path]))
            for point in scene.path:
                self._disc(PLAN, point, 0.008)

    def _pixel(self, point: np.ndarray) -> tuple[int, int]:
        x, y = point
        return round(x * self._scale), round((self._height - y) * self._scale)

    def _line(self, color: tuple[int, int, int], points: np.ndarray, width: int = 1) -> None:
        pixels = [self._pixel(point) for point in points]
        if width == 1:
            pygame.draw.aalines(self.surface, color, False, pixels)
        else:
            pygame.draw.lines(self.surface, color, False, pixels, width)

    def _disc(self, color: tuple[int, int, int] | str, center: np.ndarray, radius: float, width: int = 0) -> None:
        pygame.draw.circle(self.surface, color, self._pixel(center), max(1, round(radius * self._scale)), width)
