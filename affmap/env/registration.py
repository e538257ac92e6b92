"""Registration with Gymnasium: `affmap/Vehicle-v0` for any layout, and one environment for each file of `conf/layout`.

Does not import Gymnasium, which takes longer than importing the rest of the package, but waits for others to do so.
"""

import re
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

ENTRY_POINT, VECTOR_ENTRY_POINT = "affmap.env.vehicle:VehicleEnv", "affmap.env.vector:VehicleVectorEnv"
MAX_EPISODE_STEPS = 200


def register() -> None:
    """Register the environments for `gymnasium.make`; those that are registered already stay as they are."""
    import gymnasium

    for name, arguments in environments().items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                ENTRY_POINT,
                vector_entry_point=VECTOR_ENTRY_POINT,
                max_episode_steps=MAX_EPISODE_STEPS,
                kwargs=arguments,
            )


def environments() -> dict[str, dict[str, str]]:
    """Name in Gymnasium -> arguments of `VehicleEnv`.

    A layout's name is that of its file, whose words begin with capitals: `affmap/TwoObstacles-v0` is
    `two_obstacles.yaml`, in `conf/layout` of the package or of the current folder. The files are not read.
    """
    from affmap.settings import NAME, names

    layouts = [name for name in names("layout") if re.fullmatch(NAME, name)]
    titles = {layout: "".join(word[:1].upper() + word[1:] for word in layout.split("_")) for layout in layouts}
    return {f"affmap/{titles[layout]}-v0": {"layout": layout} for layout in layouts} | {"affmap/Vehicle-v0": {}}


def register_when_needed() -> None:
    """Register now if Gymnasium has been imported, else as soon as it is."""
    if "gymnasium" in sys.modules:
        register()
    else:
        sys.meta_path.insert(0, _AfterGymnasium())


class _AfterGymnasium(MetaPathFinder):
    """Registers the environments after the import of Gymnasium by other finders, and removes itself.

    `find_spec("gymnasium")` still answers correctly and imports nothing.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "gymnasium":
            return None
        others = (finder for finder in sys.meta_path if not isinstance(finder, _AfterGymnasium))
        spec = next(filter(None, (finder.find_spec(fullname, path, target) for finder in others)), None)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                execute(module)
                register()
                sys.meta_path.remove(self)

            spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec
