"""Rules that a syntax tree shows."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from tests.page.sources import Source

MAX_POSITIONAL = 3
MAX_COMPLEXITY = 15
MAX_PUBLIC_ARGUMENTS = 5
MAX_PRIVATE_ARGUMENTS = 8
ARRAY = re.compile(
    r"\b(Array|Flags|Bools|Ints|Indices|Bytes|NDArray|ndarray"
    # Of `core/model/shapes.py`
    r"|Frame(Values|Vectors|Matrices)|Coordinates|GeneralizedForces|Body(Vectors|Rotations|Wrenches)"
    r"|BodyJacobian|(Fixed)?Points|Loop(Rows|Jacobian)|Wrenches6|Regressor|MuscleValues|MomentArmTable"
    r"|ArmPairs|Pulls)\b"
)
SECTION = re.compile(r"^(\w+)\n-{3,}$", re.MULTILINE)
PARAMETER = re.compile(r"^(?P<names>\*{0,2}\w+(?:, \*{0,2}\w+)*) ?:", re.MULTILINE)

Function = ast.FunctionDef | ast.AsyncFunctionDef
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
BRANCHES = (
    ast.If,
    ast.For,
    ast.While,
    ast.IfExp,
    ast.ExceptHandler,
    ast.comprehension,
    ast.With,
)
COMPUTED = (
    ast.JoinedStr,
    ast.IfExp,
    ast.Lambda,
    ast.GeneratorExp,
    ast.ListComp,
    ast.SetComp,
    ast.DictComp,
)
"""What is a thought of its own, with a name of its own, and not a part of an f-string."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A place that does not follow a rule."""

    rule: str
    path: str
    line: int
    text: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.rule}: {self.text}"


def findings(source: Source) -> list[Finding]:
    """Places of a file that do not follow a rule and have no waiver."""
    return [
        Finding(rule=rule, path=source.path, line=line, text=text)
        for line, rule, text in places(source)
        if line not in source.waivers
    ]


def places(source: Source) -> Iterator[tuple[int, str, str]]:
    """Yield the line, the rule and what is wrong there, waived or not."""
    for line, comment in source.marks.items():
        if re.search(r"# fmt: (skip|off)", comment):
            yield line, "unformatted", "let ruff format it"
    tree = ast.parse(source.text)
    for node in ast.walk(tree):
        for rule, wrong in RULES_OF_NODES.get(type(node), ()):
            if text := wrong(node):
                yield node.lineno, rule, text
    for line, name in bound_again(tree):
        yield line, "rebound", f"{name} has a value already, which its readers above still ask for"
    for function, public in functions(tree):
        for rule, wrong_function in RULES_OF_FUNCTIONS:
            if text := wrong_function(function, public):
                yield function.lineno, rule, f"{function.name}: {text}"


def bound_again(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield names of a module that one statement after another gives a value."""
    known = set()
    for statement in tree.body:
        if isinstance(statement, ast.Assign):
            targets = statement.targets
        elif isinstance(statement, ast.AnnAssign) and statement.value is not None:
            targets = [statement.target]
        else:
            targets = []
        for target in targets:
            if isinstance(target, ast.Name) and target.id in known:
                yield statement.lineno, target.id
            elif isinstance(target, ast.Name):
                known.add(target.id)


def unrelated_tuple(node: ast.Assign) -> str:
    """Find `a, b = x, y`; where the right reads a target, as in a swap, it is one thought."""
    target = node.targets[0]
    if not isinstance(target, ast.Tuple) or not isinstance(node.value, ast.Tuple):
        return ""
    targets = {ast.dump(part).replace("Store", "Load") for part in target.elts}
    read = {
        ast.dump(part)
        for value in node.value.elts
        for part in ast.walk(value)
        if isinstance(part, ast.Name | ast.Attribute | ast.Subscript)
    }
    return "one assignment a statement" if targets.isdisjoint(read) else ""


def unpacked_generator(node: ast.Assign) -> str:
    """Find `a, b = (f(x) for x in y)`."""
    unpacked = isinstance(node.targets[0], ast.Tuple)
    return "write each value out" if unpacked and isinstance(node.value, ast.GeneratorExp) else ""


def positional_constructor(node: ast.Call) -> str:
    """Find a call of a class, known by its capital, with many values by position."""
    count = sum(not isinstance(value, ast.Starred) for value in node.args)
    if not _is_constructor(node) or count <= MAX_POSITIONAL:
        return ""
    return f"{count} values by position: name them"


def splat_into_constructor(node: ast.Call) -> str:
    """Find a call of a class with `*values` or `**values`."""
    starred = any(isinstance(value, ast.Starred) for value in node.args)
    double_starred = any(keyword.arg is None for keyword in node.keywords)
    return "name each field" if _is_constructor(node) and (starred or double_starred) else ""


def _is_constructor(node: ast.Call) -> bool:
    return isinstance(node.func, ast.Name) and node.func.id[:1].isupper()


def nested_conditional(node: ast.IfExp) -> str:
    """Find a conditional expression whose branch is another."""
    nested = any(isinstance(branch, ast.IfExp) for branch in (node.body, node.orelse))
    return "if and return, or a table" if nested else ""


def computed_field(node: ast.JoinedStr) -> str:
    """Find another f-string, a conditional or a loop in a replacement field of an f-string.

    Format specifications are fields too, and are looked at as f-strings of their own.
    """
    fields = [part.value for part in node.values if isinstance(part, ast.FormattedValue)]
    inner = [part for value in fields for part in ast.walk(value)]
    return (
        "give the inner value a name" if any(isinstance(part, COMPUTED) for part in inner) else ""
    )


def functions(tree: ast.Module) -> Iterator[tuple[Function, bool]]:
    """Functions and methods, and whether they are public."""
    pending: list[tuple[ast.AST, bool]] = [(tree, True)]
    while pending:
        node, public = pending.pop()
        for child in ast.iter_child_nodes(node):
            if isinstance(child, FUNCTIONS):
                yield child, public and not child.name.startswith("_")
                pending.append((child, False))
            elif isinstance(child, ast.ClassDef):
                pending.append((child, public and not child.name.startswith("_")))
            elif isinstance(child, ast.stmt | ast.ExceptHandler):
                pending.append((child, public))


def too_many_arguments(function: Function, public: bool) -> str:
    """Count arguments, which a reader has to keep apart."""
    limit = MAX_PUBLIC_ARGUMENTS if public else MAX_PRIVATE_ARGUMENTS
    count = len(arguments_of(function))
    return f"{count} arguments, at most {limit}" if count > limit else ""


def arguments_of(function: Function) -> list[ast.arg]:
    """Arguments but `self`, `cls`, `*args` and `**kwargs`."""
    every = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    return [argument for argument in every if argument.arg not in ("self", "cls")]


def dense(function: Function, public: bool) -> str:
    """Count complexity, with comprehensions, conditional expressions and boolean chains."""
    count = 1
    for node in ast.walk(function):
        count += isinstance(node, BRANCHES)
        if isinstance(node, ast.comprehension):
            count += len(node.ifs)
        elif isinstance(node, ast.BoolOp):
            count += len(node.values) - 1
    return f"complexity {count}, at most {MAX_COMPLEXITY}" if count > MAX_COMPLEXITY else ""


def missing_sections(function: Function, public: bool) -> str:
    """Name the sections that a public function lacks whose arguments or results are arrays.

    A property is read as an attribute and needs none.
    """
    if not public or _is_exempt(function):
        return ""
    annotations = [argument.annotation for argument in arguments_of(function)] + [function.returns]
    texts = [ast.unparse(annotation) for annotation in annotations if annotation is not None]
    if not any(ARRAY.search(text) for text in texts):
        return ""
    sections = _sections(function)
    missing = []
    if arguments_of(function) and "Parameters" not in sections:
        missing.append("Parameters")
    returns_value = function.returns is not None and ast.unparse(function.returns) != "None"
    if returns_value and sections.keys().isdisjoint({"Returns", "Yields"}):
        missing.append("Returns")
    return f"no section {' and '.join(missing)}" if missing else ""


def _is_exempt(function: Function) -> bool:
    decorators = [ast.unparse(decorator) for decorator in function.decorator_list]
    return any(name.endswith("property") or "overload" in name for name in decorators)


def _sections(function: Function) -> dict[str, str]:
    """Text below each heading of a docstring, by heading."""
    _, *parts = SECTION.split(ast.get_docstring(function) or "")
    return dict(zip(parts[::2], parts[1::2], strict=True))


def undescribed_arguments(function: Function, public: bool) -> str:
    """Compare the section Parameters with the arguments, as D417 does.

    It must describe all of a public function, and nothing that is none. ruff's own rule wants each
    description on a line below its name; ours stand behind it.
    """
    section = _sections(function).get("Parameters")
    if section is None:
        return ""
    entries = [entry["names"] for entry in PARAMETER.finditer(section)]
    described = {name.strip(" *") for names in entries for name in names.split(",")}
    arguments = {argument.arg for argument in arguments_of(function)}
    extras = {each.arg for each in (function.args.vararg, function.args.kwarg) if each is not None}
    wrong = described - arguments - extras
    if public:
        wrong |= {name for name in arguments - described if not name.startswith("_")}
    return f"section Parameters and arguments differ by {sorted(wrong)}" if wrong else ""


def is_bare(function: Function) -> bool:
    """Return whether a documented function has arguments and no section that describes them."""
    document = ast.get_docstring(function) or ""
    public = not function.name.startswith("_")
    return public and bool(function.args.args and document) and "Parameters" not in document


RULES_OF_NODES: dict[type[ast.AST], list[tuple[str, Callable[..., str]]]] = {
    ast.Assign: [("tuple", unrelated_tuple), ("generator", unpacked_generator)],
    ast.Call: [("positional", positional_constructor), ("splat", splat_into_constructor)],
    ast.IfExp: [("conditional", nested_conditional)],
    ast.JoinedStr: [("f-string", computed_field)],
}
RULES_OF_FUNCTIONS: list[tuple[str, Callable[[Function, bool], str]]] = [
    ("arguments", too_many_arguments),
    ("dense", dense),
    ("sections", missing_sections),
    ("parameters", undescribed_arguments),
]
MECHANICAL = (
    "unformatted",
    "tuple",
    "generator",
    "positional",
    "splat",
    "conditional",
    "f-string",
    "rebound",
)
"""Rules that need no judgement."""
JUDGED = ("arguments", "dense", "sections", "parameters")
