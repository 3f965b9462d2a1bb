"""Shapes that signatures name, checked at every call of public functions while tests run.

jaxtyping has to be imported before the package: then the names of `core/model/shapes.py` are types
that can be checked. Modules of `ROOMS` are changed as they are imported: functions and methods
whose signatures have such a name are replaced by ones that check it. Kernels have no types and stay
as they are.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from functools import cache
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import find_spec
from types import FunctionType, ModuleType
from typing import Any

ROOMS = ("myomorph.core.rigid.", "myomorph.core.muscles.")
SHAPES = "myomorph.core.model.shapes"


def check_shapes() -> bool:
    """Check shapes from now on; False where the extra "test" is incomplete, and none is checked."""
    if find_spec("jaxtyping") is None or find_spec("beartype") is None:
        return False
    assert "myomorph" not in sys.modules, "shapes are checked in modules imported later"
    import jaxtyping  # noqa: F401  # where it is imported, `SHAPES` uses it

    sys.meta_path.insert(0, CheckingFinder())
    return True


class CheckingFinder(MetaPathFinder):
    """Finds modules of `ROOMS`, and lets them be changed after they are run."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find a module, None for one of another room."""
        if not fullname.startswith(ROOMS):
            return None
        spec = PathFinder.find_spec(fullname, path)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = CheckingLoader(spec.loader.name, spec.loader.path)
        return spec


class CheckingLoader(SourceFileLoader):
    """Runs a module, then replaces what has named shapes."""

    def exec_module(self, module: ModuleType) -> None:
        """Run a module."""
        super().exec_module(module)
        _check_members(module, module.__name__)
        for value in list(vars(module).values()):
            if isinstance(value, type) and value.__module__ == module.__name__:
                _check_members(value, module.__name__)


def _check_members(owner: ModuleType | type, module: str) -> None:
    """Replace the functions of a module or class that are its own and have named shapes."""
    for name, value in list(vars(owner).items()):
        if isinstance(value, FunctionType) and value.__module__ == module and _has_shapes(value):
            setattr(owner, name, _checked(value))


def _has_shapes(function: FunctionType) -> bool:
    """Whether a signature has one of the names of `SHAPES`."""
    texts = [str(annotation) for annotation in function.__annotations__.values()]
    return any(_names().search(text) for text in texts)


@cache
def _names() -> re.Pattern[str]:
    """Pattern of the names of `SHAPES`."""
    shapes = vars(sys.modules[SHAPES])
    names = [name for name, value in shapes.items() if hasattr(value, "dim_str")]
    return re.compile(rf"\b({'|'.join(names)})\b")


def _checked(function: FunctionType) -> Callable[..., Any]:
    """Make a function that checks the shapes of its arguments and its result, and no other type."""
    from beartype import beartype
    from jaxtyping import jaxtyped

    annotations = dict(function.__annotations__)
    function.__annotations__ = {
        name: text for name, text in annotations.items() if _names().search(str(text))
    }
    checked = jaxtyped(function, typechecker=beartype)
    checked.__annotations__ = annotations
    return checked
