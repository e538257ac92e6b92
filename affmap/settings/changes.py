"""Groups of the configuration in calls: some keys and values, all as settings, or the name of a file."""

from collections.abc import Mapping
from typing import Any, TypeAlias

from affmap.settings.base import Settings, names, read
from affmap.settings.messages import ConfigError, format_value

Changes: TypeAlias = Mapping[str, Any] | Settings | str
"""Some keys and values of a group of the configuration; or all, as settings; or the name of its file in `conf`."""


def changed(group: str, values: Mapping[str, Any], changes: Any) -> dict[str, Any]:
    """The values of a group with changes, from which keys that are not given stay.

    Where the changes choose another kind, such keys have the values of the file with its name, if there is one.

    Raises:
        ConfigError: there is no such file, or the changes are none.
    """
    if changes is None:
        return dict(values)
    if isinstance(changes, str):
        return dict(read(group, changes))
    if not isinstance(changes, Mapping | Settings):
        raise ConfigError(
            f"{group} = {format_value(changes)} is not allowed: give some of its keys and values, such as "
            f"{format_value(dict([*values.items()][:1]))}, its settings, or the name of a file in conf/{group}."
        )
    new = dict(changes)
    kind = new.get("kind", values.get("kind"))
    if kind != values.get("kind"):
        values = read(group, kind) if kind in names(group) else {}
    return {**values, **new} if kind == values.get("kind") else new
