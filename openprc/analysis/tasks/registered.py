"""Tasks by the name under which a plugin registered them."""

from __future__ import annotations

import inspect
from typing import Any

from openprc.analysis.tasks.own_target import FunctionTask
from openprc.analysis.tasks.task import Task
from openprc.errors import TaskError
from openprc.hooks.faults import owned_by
from openprc.hooks.registry import Registry, default_registry


def registered_task(name: str, *, registry: Registry | None = None, **parameters: Any) -> Task:
    """Make a task by name.

    Parameters
    ----------
    name : str
        As `openprc plugins` lists it.
    registry : Registry, optional
    **parameters
        Of the task, such as ``order=10``.

    Raises
    ------
    TaskError
        When the task has no such parameter.
    PluginError
        When there is no such task, or its plugin fails or returns something else.
    """
    registry = registry or default_registry()
    item = registry.find("openprc_tasks", name)
    factory = registry.load(item)
    known = inspect.signature(factory).parameters
    unknown = sorted(set(parameters) - set(known))
    if unknown and not any(one.kind is one.VAR_KEYWORD for one in known.values()):
        raise TaskError(
            f"{name} has no parameter {unknown[0]!r}",
            expected="one of " + (", ".join(known) or "none"),
            fix="correct the name",
            key=unknown[0],
        )
    with owned_by(item.qualified_name, "being set up"):
        if _is_plain_function(factory):
            return FunctionTask(
                lambda u: factory(u, **parameters),
                name=item.name,
                source=item.spec.citation or item.qualified_name,
            )
        task = factory(**parameters)
        if not isinstance(task, Task):
            raise TypeError(f"it returned a {type(task).__name__}, not a Task")
        return task


def _is_plain_function(factory: Any) -> bool:
    """Say whether the first argument has to be given: it is the input, then."""
    if inspect.isclass(factory):
        return False
    first = next(iter(inspect.signature(factory).parameters.values()), None)
    return first is not None and first.default is first.empty
