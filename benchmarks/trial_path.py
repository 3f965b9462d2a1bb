"""Through how many files the inputs of a trial pass, from the function that opens it and from the one that runs it.

The code is read, not run. From the function that opens a trial (`open_trial`; earlier `open_take`) its first parameter
is followed, from the one that runs its steps (`run_trial`; earlier `run_take`) likewise. In a function the value is
known by the parameter's name, by names that are assigned from an expression with it, and by attributes of these. A call
that is given such a name or attribute as an argument (or is a method of it, where the class is known by an annotation)
passes the value on: to a function or class of the package, to every function of a module's table (`TABLE[key](value)`),
or to every function that modules give to a field of a value at their top (`step.run(value)`).

The value is counted in two ways.

- all: every function is followed, however deep, and whatever it is given: a number that was computed from a coordinate
  counts as the recording itself does. So vector products of muscle paths and texts of errors are among the files.
- trial: the way of a trial's inputs proper: its files, recording, model and options, as values with names. Arrays and
  numbers that were computed from them are no inputs any more, nor is what an error says of them. Rooms that carry a
  trial (`CARRY`) are gone through function by function. Of the other rooms, which know nothing of trials, the file that
  is called counts, and not what it does inside.

For both, the making of a report is left out: it is made of results (`RESULTS`).


- files: modules under `src/myomorph` that define a function or class to which the value is passed on.
- climbs: going through the calls in the order of the code, steps from one file to the next that lie in a higher room;
  the order of rooms is that of the layers in the tree's `pyproject.toml`.

`python -m benchmarks trial_path [--tree PATH]`; the tree is a checkout of this package, by default this one.
"""

from __future__ import annotations

import argparse
import ast
import tomllib
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise, product
from pathlib import Path

RESULTS = ("report_folder", "write_report")
"""What makes a report: of results, which are no inputs any more, so these functions are not gone through."""
STARTS = (("opens", ("open_take", "open_trial")), ("runs", ("run_take", "run_trial")))
PACKAGE = "myomorph"
CARRY = ("study", "report", "store", "cli", "demo")
"""Rooms that carry a trial; the others know models, recordings and files, each for itself."""
NUMBERS = {"Array", "NDArray", "ndarray", "float", "int", "bool", "Ints", "Flags"}
BUILT = {"Sequence", "Mapping", "Iterable", "Iterator", "Callable", "Literal", "tuple", "list", "dict", "set", "np"}
Name = tuple[str, str]
"""A module and a name that it defines."""


@dataclass
class Module:
    """What a file defines at its top, and what it imports anywhere, by the names used in it."""

    functions: dict[str, ast.FunctionDef] = field(default_factory=dict)
    classes: dict[str, ast.ClassDef] = field(default_factory=dict)
    values: dict[str, ast.expr] = field(default_factory=dict)
    imports: dict[str, str] = field(default_factory=dict)


class Tree:
    """The modules of a checkout."""

    def __init__(self, root: Path):
        source = root / "src"
        self.modules: dict[str, Module] = {}
        for path in sorted((source / PACKAGE).rglob("*.py")):
            name = ".".join(path.relative_to(source).with_suffix("").parts).removesuffix(".__init__")
            self.modules[name] = _module(ast.parse(path.read_text(encoding="utf-8")))
        settings = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
        contracts = settings["tool"]["importlinter"]["contracts"]
        layers = next(one["layers"] for one in contracts if one["type"] == "layers")
        self.floors = {room.strip(): -i for i, layer in enumerate(layers) for room in layer.split("|")}

    def floor(self, module: str) -> int:
        """How high a module lies, the highest room being 0."""
        inside = [room for room in self.floors if module == room or module.startswith(room + ".")]
        return self.floors[max(inside, key=len)] if inside else 0

    def find(self, module: str, name: str) -> Name | None:
        """The module that defines a function or class by the name that another uses, or None."""
        own = self.modules.get(module)
        if own is None:
            return None
        if name in own.functions or name in own.classes:
            return module, name
        target = own.imports.get(name, "")
        there, _, what = target.rpartition(".")
        return self.find(there, what) if there in self.modules and there != module else None

    def where(self, names: tuple[str, ...]) -> Name:
        """The first of the functions that the tree has."""
        for name in names:
            for module, own in self.modules.items():
                if module.startswith(f"{PACKAGE}.study") and name in own.functions:
                    return module, name
        raise SystemExit(f"the tree has none of the functions {', '.join(names)}")


def _module(tree: ast.Module) -> Module:
    found = Module()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PACKAGE):
            found.imports |= {one.asname or one.name: f"{node.module}.{one.name}" for one in node.names}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            found.functions[node.name] = node
        elif isinstance(node, ast.ClassDef):
            found.classes[node.name] = node
        elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            if isinstance(target, ast.Name):
                found.values[target.id] = node.value
    return found


class Way:
    """The way of a value through a tree.

    Parameters
    ----------
    every : everything is followed; else a trial's inputs proper
    """

    def __init__(self, tree: Tree, every: bool):
        self.tree, self.every = tree, every
        self.files: list[str] = []
        self._seen: set[tuple[str, str, frozenset[str]]] = set()

    def follow(self, module: str, name: str, node: ast.FunctionDef, given: frozenset[str], inside: str = "") -> None:
        """Go through a function that is given the value as some of its parameters."""
        if not self.every:
            own = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
            given &= {one.arg for one in own if one.arg == "self" or not _is_number(one.annotation)}
            if not given or _is_error(module):
                return
        self.files.append(module)
        if not (self.every or module.split(".")[1] in CARRY):
            return
        if (module, name, given) in self._seen:
            return
        self._seen.add((module, name, given))
        known = set(given)
        # Twice, since names may be assigned from names that are assigned later in a loop.
        for _ in range(2):
            for one in ast.walk(node):
                known |= _assigned(one, known)
        calls = [one for one in ast.walk(node) if isinstance(one, ast.Call)]
        for call in sorted(calls, key=lambda one: (one.lineno, one.col_offset)):
            self._call(module, node, call, known, inside)

    def _call(self, module: str, node: ast.FunctionDef, call: ast.Call, known: set[str], inside: str) -> None:
        given = [i for i, one in enumerate(call.args) if _is_known(one, known)]
        named = [one.arg for one in call.keywords if one.arg and _is_known(one.value, known)]
        targets = self._targets(module, node, call.func, known, inside)
        if isinstance(call.func, ast.Name) and call.func.id == "partial" and call.args:
            targets, given = self._targets(module, node, call.args[0], known, inside), [i - 1 for i in given if i]
        for there, what, owner, bound in targets:
            own = self.tree.modules[there]
            if what in own.classes and not owner:
                if given or named:
                    self._made(there, what, given, named)
                continue
            function = _method(own.classes[owner], what) if owner else own.functions.get(what)
            if function is None or what in RESULTS:
                continue
            parameters = [one.arg for one in (*function.args.posonlyargs, *function.args.args)]
            skip = 1 if owner and parameters[:1] in (["self"], ["cls"]) else 0
            passed = {parameters[i + skip] for i in given if i + skip < len(parameters)}
            passed |= {one for one in named if one in parameters or one in {k.arg for k in function.args.kwonlyargs}}
            if bound and skip:
                passed.add("self")
            if passed:
                self.follow(there, f"{owner}.{what}" if owner else what, function, frozenset(passed), owner)

    def _made(self, module: str, name: str, given: list[int], named: list[str]) -> None:
        """A class that is given the value: its file, and what its own construction does with it."""
        if _is_error(module) and not self.every:
            return
        node = self.tree.modules[module].classes[name]
        self.files.append(module)
        made = _method(node, "__init__")
        if made is not None:
            parameters = [one.arg for one in made.args.args][1:]
            passed = {parameters[i] for i in given if i < len(parameters)} | set(named)
            self.follow(module, f"{name}.__init__", made, frozenset(passed | {"self"}), name)

    def _targets(
        self, module: str, node: ast.FunctionDef, func: ast.expr, known: set[str], inside: str
    ) -> list[tuple[str, str, str, bool]]:
        """What a call goes to: module, name, the class whose method it is, and whether that is the value itself."""
        tree = self.tree
        if isinstance(func, ast.Name):
            found = tree.find(module, func.id)
            return [(*found, "", False)] if found else []
        if isinstance(func, ast.Subscript) and isinstance(func.value, ast.Name):
            table = tree.modules[module].values.get(func.value.id)
            names = [one.id for one in ast.walk(table) if isinstance(one, ast.Name)] if table is not None else []
            return [(*found, "", False) for one in names if (found := tree.find(module, one))]
        if not isinstance(func, ast.Attribute):
            return []
        if isinstance(func.value, ast.Name) and func.value.id == "self" and inside:
            return [(module, func.attr, inside, "self" in known)]
        if isinstance(func.value, ast.Name) and (other := tree.modules[module].imports.get(func.value.id, "")):
            found = tree.find(other, func.attr) if other in tree.modules else None
            if found:
                return [(*found, "", False)]
        owner = self._class_of(module, node, func.value)
        if owner is None:
            return []
        there, name = owner
        if _method(tree.modules[there].classes[name], func.attr) is not None:
            return [(there, func.attr, name, _is_known(func.value, known))]
        return [(*one, "", False) for one in self._given_to(name, func.attr)]

    def _class_of(self, module: str, node: ast.FunctionDef, value: ast.expr) -> Name | None:
        """The class of a value, where an annotation of a parameter or of what a function returns names it."""
        annotation = None
        if isinstance(value, ast.Name):
            every = (*node.args.args, *node.args.kwonlyargs)
            annotation = next((one.annotation for one in every if one.arg == value.id), None)
            for one in ast.walk(node):
                if not (isinstance(one, ast.Assign) and isinstance(one.value, ast.Call) and annotation is None):
                    continue
                if any(isinstance(each, ast.Name) and each.id == value.id for each in one.targets):
                    return self._class_of(module, node, one.value)
        elif isinstance(value, ast.Call) and isinstance(value.func, ast.Name):
            found = self.tree.find(module, value.func.id)
            if found is None:
                return None
            module, name = found
            if name in self.tree.modules[module].classes:
                return found
            annotation = self.tree.modules[module].functions[name].returns
        for one in ast.walk(annotation) if annotation is not None else ():
            if isinstance(one, ast.Name):
                found = self.tree.find(module, one.id)
                if found and found[1] in self.tree.modules[found[0]].classes:
                    return found
        return None

    def _given_to(self, owner: str, name: str) -> list[Name]:
        """Functions that modules give to a field of values of a class at their top: `STEP = Step(run=_run)`."""
        found = []
        for module, own in self.tree.modules.items():
            for value in own.values.values():
                if isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and value.func.id == owner:
                    for one in value.keywords:
                        if one.arg == name and isinstance(one.value, ast.Name):
                            target = self.tree.find(module, one.value.id)
                            found += [target] if target else []
        return found


def _method(node: ast.ClassDef, name: str) -> ast.FunctionDef | None:
    return next((one for one in node.body if isinstance(one, ast.FunctionDef) and one.name == name), None)


def _is_error(module: str) -> bool:
    return module.endswith(".errors")


def _is_number(annotation: ast.expr | None) -> bool:
    """Whether a parameter is an array or a number; those of compiled kernels have no annotations."""
    if annotation is None:
        return True
    names = {one.id for one in ast.walk(annotation) if isinstance(one, ast.Name)} - BUILT
    return bool(names) and names <= NUMBERS


def _is_known(node: ast.expr, known: set[str]) -> bool:
    """Whether an argument is one of the names, or an attribute of one."""
    if isinstance(node, ast.Starred):
        node = node.value
    while isinstance(node, ast.Attribute):
        node = node.value
    return isinstance(node, ast.Name) and node.id in known


def _assigned(node: ast.AST, known: set[str]) -> set[str]:
    """Names that are assigned from an expression with one of the names."""
    if isinstance(node, ast.Assign):
        targets, value = node.targets, node.value
    elif isinstance(node, ast.AnnAssign | ast.AugAssign | ast.NamedExpr) and node.value is not None:
        targets, value = [node.target], node.value
    elif isinstance(node, ast.For | ast.comprehension):
        targets, value = [node.target], node.iter
    else:
        return set()
    if not any(isinstance(one, ast.Name) and one.id in known for one in ast.walk(value)):
        return set()
    return {one.id for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)}


def count(root: Path) -> list[dict[str, object]]:
    """Files and climbs of a tree, a row for each of `STARTS` and way of counting."""
    tree, rows = Tree(root), []
    for (what, names), every in product(STARTS, (False, True)):
        module, name = tree.where(names)
        node, way = tree.modules[module].functions[name], Way(tree, every)
        way.follow(module, name, node, frozenset({node.args.args[0].arg}))
        floors = [tree.floor(one) for one in way.files]
        climbs = sum(after > before for before, after in pairwise(floors))
        rooms = Counter(one.split(".")[1] for one in set(way.files))
        told = ", ".join(f"{room} {files}" for room, files in sorted(rooms.items()))
        whose = {"what": what, "function": name, "counted": "all" if every else "trial"}
        rows.append({**whose, "files": rooms.total(), "climbs": climbs, "by room": told})
    return rows


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of the command line."""
    parser.add_argument("--tree", type=Path, default=Path(__file__).parents[1], help="a checkout; this one by default")


def run(tree: Path) -> list[dict[str, object]]:
    """The rows of a checkout."""
    return count(tree)
