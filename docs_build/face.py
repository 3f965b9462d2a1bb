"""Tables of the public names: what `import myomorph as mm` reaches, by namespace.

A line `<!-- names: mm.morph -->` of a page stands for the table of that namespace. When the site
is built, the table replaces it: one row per name, with the first sentence of its docstring.
"""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import myomorph as mm

TABLE = re.compile(r"^<!-- names: (?P<namespace>[\w.]+) -->$", re.MULTILINE)
Definition = tuple[str, str]
"""A module of the package, and a name that is defined there."""


def namespaces() -> dict[str, ModuleType]:
    """`mm` and what it has of namespaces, by the names that users write."""
    inner = {
        f"mm.{name}": getattr(mm, name)
        for name in sorted(mm.__all__)
        if inspect.ismodule(getattr(mm, name))
    }
    return {"mm": mm, **inner}


def names_of(namespace: ModuleType) -> tuple[str, ...]:
    """Public functions and classes of a namespace, sorted; namespaces within it are left out."""
    return tuple(
        name for name in sorted(namespace.__all__) if not inspect.ismodule(getattr(namespace, name))
    )


def public() -> dict[str, Any]:
    """Every public function and class by the name that users write, as `mm.morph.Morph`."""
    return {
        f"{space}.{name}": getattr(module, name)
        for space, module in namespaces().items()
        for name in names_of(module)
    }


def first_sentence(value: object) -> str:
    """Return a docstring up to its first full stop or blank line."""
    paragraph = inspect.cleandoc(value.__doc__ or "").split("\n\n")[0].replace("\n", " ")
    return re.split(r"(?<=[^.])\.(?:\s|$)", paragraph, maxsplit=1)[0]


def table(namespace: str) -> str:
    """Return the names of a namespace as a table of Markdown.

    Raises
    ------
    KeyError
        where there is no such namespace
    """
    module = namespaces()[namespace]
    rows = []
    for name in names_of(module):
        sentence = first_sentence(getattr(module, name)).replace("|", r"\|")
        rows.append(f"| `{namespace}.{name}` | {sentence} |")
    return "\n".join(("| name | what it is |", "| --- | --- |", *rows))


def with_names(markdown: str) -> str:
    """Return a page with the tables of names in place."""
    return TABLE.sub(lambda line: table(line["namespace"]), markdown)


def types_in_signature(function: Any) -> dict[str, set[Definition]]:
    """Classes of the package that a function takes or gives, by parameter, and "return"."""
    signature = inspect.signature(function)
    annotations = {name: parameter.annotation for name, parameter in signature.parameters.items()}
    annotations["return"] = signature.return_annotation
    return {
        name: set(_classes(function.__module__, annotation))
        for name, annotation in annotations.items()
    }


def types_in_fields(kind: type) -> dict[str, set[Definition]]:
    """Return the classes of the package in the fields of a dataclass, by field.

    Fields that `repr` hides are the package's own.
    """
    if not dataclasses.is_dataclass(kind):
        return {}
    hidden = {field.name for field in dataclasses.fields(kind) if not field.repr}
    return {
        name: set(_classes(base.__module__, annotation))
        for base in kind.__mro__
        for name, annotation in vars(base).get("__annotations__", {}).items()
        if name not in hidden and not name.startswith("_")
    }


def _classes(module: str, annotation: object) -> Iterator[Definition]:
    """Yield the classes of the package that an annotation of a module names.

    Aliases are replaced by what they stand for.
    """
    text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    for node in ast.walk(_Plain().visit(ast.parse(text, mode="eval"))):
        if isinstance(node, ast.Name):
            yield from _definition(module, node.id)
        elif (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and node.value.isidentifier()
        ):
            yield from _definition(module, node.value)


class _Plain(ast.NodeTransformer):
    """Annotations without what `Annotated` adds to a type."""

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        """Return the type alone."""
        self.generic_visit(node)
        annotated = isinstance(node.value, ast.Name) and node.value.id == "Annotated"
        return node.slice.elts[0] if annotated and isinstance(node.slice, ast.Tuple) else node


@cache
def _tree(module: str) -> ast.Module:
    file = importlib.import_module(module).__file__
    return ast.parse(Path(file).read_text(encoding="utf-8"))


@cache
def _definition(module: str, name: str) -> tuple[Definition, ...]:
    """Return where a name of a module is defined.

    Imports are followed, those for type checkers too.
    """
    for node in ast.walk(_tree(module)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("myomorph"):
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    return _definition(node.module, alias.name)
    for node in _tree(module).body:
        if isinstance(node, ast.ClassDef) and node.name == name:
            return ((module, name),)
        if isinstance(node, ast.Assign | ast.AnnAssign) and name in _assigned(node):
            parts = _parts(node.value)
            return tuple(kind for part in parts for kind in _classes(module, ast.unparse(part)))
    return ()


def _assigned(node: ast.Assign | ast.AnnAssign) -> set[str]:
    """Return the names that an assignment gives a value."""
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    return {target.id for target in targets if isinstance(target, ast.Name)}


def _parts(value: ast.expr | None) -> list[ast.expr]:
    """Return the types that an alias stands for; of a type variable, what it is bound to."""
    if value is None:
        return []
    if isinstance(value, ast.Call):
        return [*value.args[1:], *(word.value for word in value.keywords)]
    return [value]
