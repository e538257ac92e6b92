"""Plots of the arena: the drawing functions of reports, arrays of a map, and paths made by hand."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from handmade import ORIGINAL, PLANNER, SETTINGS, TWO, make_map, make_runs, make_stack
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from numpy.testing import assert_allclose, assert_array_equal

import affmap
from affmap.control.agent import Agent
from affmap.control.oracle import Oracle
from affmap.control.time_to_go import TimeToGo
from affmap.env.effects import EFFECTS
from affmap.env.layout import Layout
from affmap.env.procedural import Procedural
from affmap.model.lookup import AffordanceMap, ExactLookup
from affmap.planning.cem import CEMPlanner
from affmap.random import generator
from affmap.report.drawing import arena
from affmap.report.drawing.colors import GROUP_COLORS
from affmap.settings import ConfigError

FOG = Layout.load("layout", "fog")


def axes() -> Axes:
    return Figure().subplots()


def pixels(ax: Axes) -> np.ndarray:
    canvas = FigureCanvasAgg(ax.figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def test_a_layout_is_drawn_as_reports_draw_it() -> None:
    """The same pixels: by its name, as it is, by its keys and values; and a vehicle of another size is larger."""
    expected = pixels(arena.world_map(axes(), ORIGINAL, radius=0.06))
    for given in ("original", ORIGINAL, ORIGINAL.model_dump(mode="json")):
        assert_array_equal(pixels(affmap.plot.layout(given, ax=axes())), expected)
    vehicle = affmap.Vehicle.load("vehicle", "default", radius=0.09)
    larger = pixels(arena.world_map(axes(), ORIGINAL, radius=0.09))
    for given in (vehicle, {"radius": 0.09}):
        assert_array_equal(pixels(affmap.plot.layout("original", vehicle=given, ax=axes())), larger)


def test_a_legend_names_effects_but_no_obstacles_alone() -> None:
    assert affmap.plot.layout("original", ax=axes()).get_legend() is None
    legend = affmap.plot.layout("four_properties", ax=axes()).get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["pulls up", "pulls down", "fog", "obstacle"]


def test_rules_are_drawn_as_the_first_world_of_member_0() -> None:
    world = Procedural.load("layout", "procedural_easy").draw(generator(0, "world", 0))
    by_rules, alone = (affmap.plot.layout(given, ax=axes()) for given in ("procedural_easy", world))
    assert_array_equal(pixels(by_rules), pixels(alone))


def test_a_map_is_its_picture_with_nodes_where_they_are() -> None:
    """13 x 9 nodes, 0.25 u apart from border to border: the outermost pixels reach half of that beyond."""
    painted = make_map()
    for index in range(2):
        (image,) = affmap.plot.affordance_map(painted, index=index, ax=axes()).images
        assert_array_equal(image.get_array(), painted.picture(index))
        assert_allclose(image.get_extent(), (-0.125, 3.125, -0.125, 2.125))
    assert np.ptp(painted.picture(0) - painted.picture(1)) > 0


def test_a_map_of_several_worlds_outlines_the_circles_of_its_own() -> None:
    """Each member has a world: six small obstacles, two large ones."""
    painted = make_map(worlds=(ORIGINAL.map, TWO.map))
    outlines = [affmap.plot.affordance_map(painted, index=index, ax=axes()).patches for index in range(2)]
    for patches, world in zip(outlines, (ORIGINAL, TWO), strict=True):
        assert [(*patch.center, patch.radius) for patch in patches] == [(*c.center, c.radius) for c in world.circles]


def test_an_agent_shows_its_map_and_one_without_a_map_that_of_reports() -> None:
    """Exact look-ups against a map with nodes every 0.02 u, as in `conf/report/default.yaml`."""
    stack = make_stack(3)
    fine = AffordanceMap.paint(stack, [ORIGINAL.map], spacing=0.02)
    for lookup in (fine, ExactLookup(stack, [ORIGINAL.map])):
        agent = Agent(stack, lookup, PLANNER, SETTINGS)
        assert_array_equal(affmap.plot.affordance_map(agent, ax=axes()).images[0].get_array(), fine.picture())


def test_what_has_no_map_is_told_in_a_sentence() -> None:
    oracle = Oracle([ORIGINAL], affmap.Vehicle.load("vehicle", "default"), PLANNER, SETTINGS)
    for source, index, message in (
        (make_map(context_size=0), 0, "context size 0 have no codes"),
        (make_map(), 2, "index = 2 is not allowed: there are 2 maps, 0 to 1."),
        (oracle, 0, "Oracle has no affordance map; give a map, or an agent with a trained model."),
    ):
        with pytest.raises(ConfigError, match=message):
            affmap.plot.affordance_map(source, index=index, ax=axes())  # type: ignore[arg-type]


def columns(goal: tuple[float, float] = (0.1, 1.0)) -> TimeToGo:
    """Times of a vehicle that takes 10 steps from a node to the next one, and gets on along x and y only."""
    x, y = np.linspace(0.1, 2.9, 29), np.linspace(0.1, 1.9, 19)
    costs = np.where(np.arange(8)[:, None, None] % 2, np.inf, np.full((8, 19, 29), 10.0))
    return TimeToGo(costs[None], x, y, np.array([goal]), pace=100.0)


def test_lines_of_equal_times_are_where_the_times_are_equal() -> None:
    """Closed form: 100 steps per u of |x - 0.1| + |y - 1| - 0.1 (u), its neighbours being there."""
    ways = columns()
    stack = make_stack(3)
    agent = Agent(stack, AffordanceMap.paint(stack, [ORIGINAL.map], spacing=0.1), PLANNER, SETTINGS)
    (lines,) = (
        each for each in affmap.plot.time_to_go(agent, ways, ax=axes()).collections if len(each.get_paths()) > 1
    )
    assert ways.levels()[0] > 0 and len(lines.get_paths()) == len(ways.levels())
    for level, path in zip(ways.levels(), lines.get_paths(), strict=True):
        points = path.vertices[np.abs(path.vertices - (0.1, 1.0)).min(1) > 0.1]  # not in the cells of the kink
        assert_allclose(100 * np.abs(points - (0.1, 1.0)).sum(1) - 10, level, atol=1e-6)


def test_keys_and_doors_have_their_colours() -> None:
    """Over the map of a world with both: a rim each, on white, at their places; none once the doors are open."""
    values = [(0.75, 0.5, "obstacle"), (1.5, 1.0, "door"), (2.0, 1.0, "door"), (0.5, 1.5, "key")]
    circles = [{"center": [x, y], "radius": 0.2, "effect": name, "channel": "solid"} for x, y, name in values]
    layout = Layout.load("layout", "original", circles=circles)
    stack = make_stack(3)
    for world, effects in ((layout, ("key", "door")), (layout.opened, ())):
        ax = affmap.plot.affordance_map(AffordanceMap.paint(stack, [world.map], spacing=0.1), ax=axes())
        ellipses = [each for each in ax.patches if type(each) is Ellipse]
        found = {
            (to_hex(each.get_edgecolor()), tuple(np.ravel(each.center).tolist()), each.width / 2) for each in ellipses
        }
        expected = [each for each in layout.circles if each.effect in effects]
        colors = {each: (EFFECTS[each.effect].color, "#ffffff") for each in expected}
        assert found == {(color, each.center, each.radius) for each in expected for color in colors[each]}


def test_scraps_of_lines_are_not_drawn() -> None:
    """A line that is shorter than two spacings, where all nodes but four are masked; the others stay whole."""
    ways = columns()
    steps = ways.clear()
    whole = arena.times_to_go(axes(), steps, ways.x, ways.y, np.array([50.0])).collections[0].get_paths()[0]
    assert len(whole.vertices) > 5
    steps[:, :] = np.ma.array(steps.data, mask=True)
    steps[2:4, 2:4] = np.ma.array(ways.steps[0, 2:4, 2:4], mask=False)
    middle = np.array([float(steps.mean())])
    (left,) = arena.times_to_go(axes(), steps, ways.x, ways.y, middle).collections[0].get_paths()
    assert not len(left.vertices)


def test_there_are_no_times_to_more_goals_than_imagined() -> None:
    stack = make_stack(3)
    agent = Agent(stack, AffordanceMap.paint(stack, [ORIGINAL.map, TWO.map], spacing=0.1), PLANNER, SETTINGS)
    with pytest.raises(ConfigError, match="index = 1 is not allowed: there are times to go to 1 goals only"):
        affmap.plot.time_to_go(agent, columns(), index=1, ax=axes())


def test_paths_are_drawn_from_start_to_end_in_the_colour_of_their_run() -> None:
    """By hand: three paths, their ends, and their goals, crosses 0.04 u to every side."""
    runs = make_runs([ORIGINAL] * 3)
    lines = affmap.plot.trajectories(runs, ax=axes()).lines
    paths = [line for line in lines if len(line.get_xdata()) == 3]
    ends = [line for line in lines if line.get_marker() == "o"]
    strokes = np.array([line.get_xydata() for line in lines if len(line.get_xdata()) == 2])
    assert_allclose([line.get_xydata() for line in paths], runs.trajectories["position"])
    assert_allclose([line.get_xydata()[0] for line in ends], runs.trajectories["position"][:, -1])
    assert [line.get_color() for line in paths] == [line.get_color() for line in ends] == [*GROUP_COLORS[:3]]
    assert_allclose(strokes.mean(axis=1)[::2], runs.trajectories["goal"])
    assert_allclose(np.ptp(strokes, axis=1), 0.08)


def test_many_paths_are_transparent() -> None:
    """12 are not, 24 are half, a thousand a fifth."""
    for count, opacity in ((12, 1.0), (24, 0.5), (1000, 0.2)):
        runs = make_runs([ORIGINAL] * count)
        ax = affmap.plot.trajectories(runs, ax=axes())
        assert {line.get_alpha() for line in ax.lines if len(line.get_xdata()) == 3} == {opacity}


def test_only_the_runs_in_the_layout_are_drawn() -> None:
    """Runs 0 and 2; and without the layout, or in one where none flew, a sentence."""
    runs = make_runs([ORIGINAL, FOG, ORIGINAL])
    lines = affmap.plot.trajectories(runs, "original", ax=axes()).lines
    starts = [line.get_ydata()[0] for line in lines if len(line.get_xdata()) == 3]
    assert starts == pytest.approx([0.2, 0.4])
    with pytest.raises(ConfigError, match=r"flew in 2 layouts; choose one, such as layout=runs.layouts\[0\]"):
        affmap.plot.trajectories(runs)
    with pytest.raises(ConfigError, match="no run flew in this layout 'two_obstacles'; they flew in original, fog"):
        affmap.plot.trajectories(runs, "two_obstacles")


def test_a_plan_is_drawn_with_three_standard_deviations() -> None:
    """By hand: run 1, step 1, three imagined positions; ellipses, the discs of their centres, and the vehicle."""
    ax = affmap.plot.plan(make_runs([ORIGINAL] * 2), 1, 1, ax=axes())
    shapes = [(*patch.get_center(), patch.width, patch.height) for patch in ax.patches if isinstance(patch, Ellipse)]
    x, y = 0.2 + 0.5, 0.3
    ellipses = [(x + 0.1, y, 0.06, 0.12), (x + 0.2, y, 0.12, 0.24), (x + 0.3, y, 0.18, 0.36)]
    others = [*[(x + 0.1 * step, y, 0.028, 0.028) for step in (1, 2, 3)], (x, y, 0.12, 0.12)]
    assert_allclose(shapes[-7:], [*ellipses, *others])
    (plan,) = [line for line in ax.lines if line.get_color() == "#0072b2"]
    assert_allclose(plan.get_xydata(), [(x, y), (x + 0.1, y), (x + 0.2, y), (x + 0.3, y)])
    for index, step, message in ((2, 0, "index = 2 .* from 0 to 1"), (0, 2, "step = 2 .* from 0 to 1"), (0, -1, "-1")):
        with pytest.raises(ConfigError, match=message):
            affmap.plot.plan(make_runs([ORIGINAL] * 2), index, step)


def test_a_plan_shows_the_vehicle_that_flew() -> None:
    """The disc that is drawn last: of the runs' own radius, or of that which is asked for."""
    runs = replace(make_runs([ORIGINAL]), vehicle=affmap.Vehicle(radius=0.09))
    for given, radius in ((None, 0.09), ("default", 0.06), ({"radius": 0.05}, 0.05)):
        *_, vehicle = affmap.plot.plan(runs, vehicle=given, ax=axes()).patches
        assert isinstance(vehicle, Ellipse) and vehicle.width == pytest.approx(2 * radius)


def test_something_else_than_runs_is_told() -> None:
    agent = Agent(make_stack(0), ExactLookup(make_stack(0), [ORIGINAL.map]), PLANNER, SETTINGS)
    for draw in (affmap.plot.trajectories, affmap.plot.plan):
        with pytest.raises(ConfigError, match=r"^runs = Agent\(.* is not allowed; give runs of affmap\.fly\.$"):
            draw(agent)  # type: ignore[operator]


def test_flights_can_be_drawn_as_they_come() -> None:
    """Runs of an untrained agent: as many paths as runs, each as long as the flight."""
    stack = make_stack(3, seeds=(4,))
    settings = SETTINGS.model_copy(update={"num_steps": 3})
    agent = Agent(stack, ExactLookup(stack, [ORIGINAL.map]), CEMPlanner.load("planner", "cem", horizon=2), settings)
    before = torch.get_num_threads()
    runs = affmap.fly(agent, "two_obstacles")
    assert runs.layouts == [TWO] * 4 and torch.get_num_threads() == before
    lines = [line for line in affmap.plot.trajectories(runs, ax=axes()).lines if len(line.get_xdata()) == 4]
    assert len(lines) == 4 and {to_rgba(line.get_color()) for line in lines} == {*map(to_rgba, GROUP_COLORS[:4])}
