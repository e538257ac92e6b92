"""Pictures of the vehicle in its world (pygame): arena, circles, goal, throttles, planned path.

Knows geometry only; physics and episodes are elsewhere.
"""

import numpy as np
import pygame

from affmap.effects import EFFECTS
from affmap.env.layout import Layout
from affmap.env.physics import THROTTLES, Vehicle

PIXELS_PER_UNIT = 200
WHITE, BLACK = (255, 255, 255), (0, 0, 0)
VEHICLE, THROTTLE, GOAL, PLAN = (0, 140, 70), (30, 90, 220), (220, 40, 40), (30, 30, 30)


class Canvas:
    """A picture of a world, drawn anew each time; rows go downward, as pictures do."""

    def __init__(self, size: tuple[float, float], vehicle: Vehicle, window: bool) -> None:
        """Prepare pictures of arenas of `size` (u); with `window`, `show` puts them on the screen."""
        self._height, self._vehicle = size[1], vehicle
        width, height = (round(length * PIXELS_PER_UNIT) for length in size)
        self._surface = pygame.Surface((width, height))
        self._window: pygame.Surface | None = None
        if window:
            pygame.display.init()
            pygame.display.set_caption("affmap")
            self._window = pygame.display.set_mode((width, height))
            self._clock = pygame.time.Clock()

    def draw(
        self,
        layout: Layout,
        position: np.ndarray,
        action: np.ndarray,
        goal: np.ndarray,
        goal_radius: float,
        planned_positions: np.ndarray | None,
    ) -> None:
        """Draw everything once.

        Args:
            layout: the world.
            position: `[2]`, u.
            action: `[4]`, opening of the throttles.
            goal: `[2]`, u.
            goal_radius: u.
            planned_positions: `[H, 2]` in u, or None.
        """
        self._surface.fill(WHITE)
        layers = list(EFFECTS)
        for circle in sorted(layout.circles, key=lambda circle: layers.index(circle.effect)):
            self._disc(EFFECTS[circle.effect].color, np.array(circle.center), circle.radius)
        pygame.draw.rect(self._surface, BLACK, self._surface.get_rect(), width=2)
        self._disc(GOAL, goal, goal_radius, width=2)
        self._disc(GOAL, goal, 0.02)
        if planned_positions is not None:
            path = [self._pixel(point) for point in np.vstack([position, planned_positions])]
            pygame.draw.aalines(self._surface, PLAN, False, path)
            for point in planned_positions:
                self._disc(PLAN, point, 0.008)
        for direction, opening in zip(THROTTLES, action, strict=True):
            # The jet leaves on the side opposite to where it pushes.
            rim = position - direction * self._vehicle.radius
            end = rim - direction * 0.12 * opening
            pygame.draw.line(self._surface, THROTTLE, self._pixel(rim), self._pixel(end), width=5)
        self._disc(VEHICLE, position, self._vehicle.radius)

    def array(self) -> np.ndarray:
        """The picture, `[height, width, 3]` uint8."""
        return np.transpose(pygame.surfarray.array3d(self._surface), (1, 0, 2)).copy()

    def show(self, frames_per_second: int) -> None:
        """Put the picture on the screen and wait for its time to pass."""
        if self._window is not None:
            self._window.blit(self._surface, (0, 0))
            pygame.event.pump()
            pygame.display.flip()
            self._clock.tick(frames_per_second)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            pygame.display.quit()
            self._window = None

    def _pixel(self, point: np.ndarray) -> tuple[int, int]:
        x, y = point
        return round(x * PIXELS_PER_UNIT), round((self._height - y) * PIXELS_PER_UNIT)

    def _disc(self, color: tuple[int, int, int] | str, center: np.ndarray, radius: float, width: int = 0) -> None:
        pygame.draw.circle(self._surface, color, self._pixel(center), max(1, round(radius * PIXELS_PER_UNIT)), width)
