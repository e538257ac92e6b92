"""The pages of the environments that affmap registers with Gymnasium, and a gallery of them.

Spaces are asked of an environment, and its picture is drawn by it. All else is the docstring of `VehicleEnv`, and the
file of the layout.
"""

import inspect
import re
from collections.abc import Iterator

import griffe
import gymnasium
import imageio.v3 as imageio
from api import member
from places import ROOT

from affmap.env.registration import environments
from affmap.env.vehicle import VehicleEnv
from affmap.report.markdown import table


def pages() -> Iterator[tuple[str, str]]:
    """Place in the site -> Markdown, for each environment."""
    for name, arguments in environments().items():
        yield f"environments/{_short(name)}.md", _page(name, arguments.get("layout"))


def pictures() -> Iterator[tuple[str, bytes]]:
    """Place in the site -> PNG, for each environment: the vehicle in a start corner, and its goal."""
    for name in environments():
        env = gymnasium.make(name, render_mode="rgb_array")
        env.reset(seed=0, options={"corner": 0})
        yield f"environments/{_short(name)}.png", imageio.imwrite("<bytes>", env.render(), extension=".png")
        env.close()


def gallery() -> str:
    """Cards of the environments of all layouts, with their pictures; for a page in the folder `docs` itself."""
    cards = [
        f"-   [![The arena of {name}](environments/{_short(name)}.png)](environments/{_short(name)}.md)\n\n"
        f"    [`{name}`](environments/{_short(name)}.md)\n\n    {_about(arguments['layout'])[0]}\n"
        for name, arguments in environments().items()
        if arguments
    ]
    return "\n".join(['<div class="grid cards" markdown>\n', *cards, "</div>"])


def _short(name: str) -> str:
    return name.removeprefix("affmap/")


def _page(name: str, layout: str | None) -> str:
    env = gymnasium.make(name)
    assert isinstance(env.observation_space, gymnasium.spaces.Dict)
    assert env.spec
    facts = {
        "Action space": f"`{env.action_space}`",
        "Observation space": "<br>".join(f"`{key}`: `{space}`" for key, space in env.observation_space.items()),
        "Import": f'`gymnasium.make("{name}")`',
        "Episode": f"{env.spec.max_episode_steps} steps, {env.metadata['render_fps']} a second",
        "Class": "[`affmap.VehicleEnv`][affmap.env.vehicle.VehicleEnv]",
    }
    about = " ".join(_about(layout)) if layout else "Any layout of your own, or rules for random ones."
    parts = [
        f"# {name}",
        f"![The vehicle in its start corner, and its goal]({_short(name)}.png){{ .arena }}",
        about,
        table(["", ""], [*facts.items()]),
        inspect.getdoc(VehicleEnv).partition("\n\n")[2],
        "## Arguments",
        _arguments(layout),
    ]
    if layout:
        text = (ROOT / f"conf/layout/{layout}.yaml").read_text("utf-8")
        parts += ["## Layout", f"`conf/layout/{layout}.yaml`:", f"```yaml\n{text.strip()}\n```"]
    return "\n\n".join(parts)


def _about(layout: str) -> list[str]:
    """Sentences of the comment at the head of a layout's file."""
    text = (ROOT / f"conf/layout/{layout}.yaml").read_text("utf-8")
    head = re.match(r"(?:#.*\n)*", text)
    assert head
    return re.split(r"(?<=\.) ", " ".join(line.lstrip("# ") for line in head[0].splitlines()))


def _arguments(layout: str | None) -> str:
    """The arguments of an environment with their defaults, as its docstring describes them."""
    docstring = member("affmap.env.vehicle.VehicleEnv.__init__").docstring
    assert docstring
    (section,) = (each for each in docstring.parse("google") if each.kind is griffe.DocstringSectionKind.parameters)
    signature = inspect.signature(VehicleEnv).parameters
    defaults = {name: parameter.default for name, parameter in signature.items()} | (
        {"layout": layout} if layout else {}
    )
    rows = [
        (f"`{each.name}`", f"`{defaults[each.name]!r}`", " ".join(each.description.split())) for each in section.value
    ]
    return table(["argument", "default", "meaning"], rows)
