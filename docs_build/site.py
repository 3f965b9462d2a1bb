"""Hooks of mkdocs: what the site has beyond the pages of `docs/`.

Those are navigation, tables of results, equations as MathML, a reference of every module, and the
changelog.
"""

from __future__ import annotations

import ast
import html
import re
import sys
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
# mkdocs runs this file by its path alone: its own folder is no package there.
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from docs_build.command_line import with_commands  # noqa: E402
from docs_build.face import with_names  # noqa: E402
from docs_build.navigation import navigation, with_listed  # noqa: E402
from docs_build.notebooks import notebook_text, tutorials  # noqa: E402
from docs_build.programs import with_programs  # noqa: E402
from docs_build.quantities import with_quantities  # noqa: E402
from docs_build.tables import rendered  # noqa: E402

PACKAGE = ROOT / "src" / "myomorph"
# Wings, from the main job outwards.
WINGS = ("core", "body", "lab", "bones", "swings", "exchange", "live", "show", "forward")
# Names that the converter does not know, by those that it does.
TEX = {r"\arg": r"\operatorname{arg}"}


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Make the navigation: groups of the index, with all modules at the end of the reference."""
    rooms = [
        {room: [f"reference/{room}/index.md", *(page_of(module) for module in modules(room))]}
        for room in WINGS
    ]
    groups = navigation()
    reference = next(group["Reference"] for group in groups if "Reference" in group)
    reference.append({"Modules": ["reference/index.md", *rooms]})
    config.nav = groups
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add pages that are derived from the package and from files outside `docs/`.

    The notebooks of the tutorials are added too.
    """
    made = {
        # It lies beside docs/, and in the site among its pages.
        "changelog.md": (
            (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").replace("](docs/", "](")
        ),
        "reference/index.md": reference_index(),
    }
    for room in WINGS:
        made[f"reference/{room}/index.md"] = room_index(room)
        made |= {page_of(module): module_page(module) for module in modules(room)}
    made |= {f"tutorials/{page.stem}.ipynb": notebook_text(page) for page in tutorials()}
    for name, text in made.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Put tables and numbers of results in place; tutorials name their notebook."""
    source = Path(page.file.src_uri)
    markdown = with_quantities(with_names(rendered(markdown, page.file.src_uri)))
    markdown = with_programs(with_commands(markdown))
    markdown = with_listed(markdown, page.file.src_uri)
    # The index has the changelog beside docs/; in the site it is a page like others.
    markdown = markdown.replace("](../CHANGELOG.md)", "](changelog.md)")
    if source.parts[0] != "tutorials" or source.stem == "index":
        return markdown
    heading, _, rest = markdown.partition("\n")
    return f"{heading}\n\n[This page as a notebook]({source.stem}.ipynb)\n{rest}"


def on_page_content(html_text: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Equations as MathML, which browsers show without a script."""
    return re.sub(
        r'<(span|div) class="arithmatex">(.*?)</\1>', _equation, html_text, flags=re.DOTALL
    )


def _equation(found: re.Match[str]) -> str:
    tex = html.unescape(found[2]).strip()
    block = tex.startswith(r"\[")
    tex = tex[2:-2].strip()
    for unknown, known in TEX.items():
        tex = re.sub(re.escape(unknown) + r"(?![a-zA-Z])", lambda _, known=known: known, tex)
    made = convert(tex, display="block" if block else "inline")
    left = re.findall(r"\\[a-zA-Z]+", made)
    if left:
        raise ValueError(f"equation with commands that are not known: {left} in {tex}")
    return made


def modules(room: str) -> list[Path]:
    """Modules of a wing and of the rooms in it by name, without those that a program alone uses."""
    return sorted(path for path in (PACKAGE / room).rglob("*.py") if not path.stem.startswith("_"))


def page_of(module: Path) -> str:
    """Where a module's page lies in the site."""
    page = module.relative_to(PACKAGE).with_suffix(".md")
    return f"reference/{page.as_posix()}"


def module_page(module: Path) -> str:
    """Page of one module, filled by mkdocstrings."""
    name = ".".join(module.relative_to(PACKAGE).with_suffix("").parts)
    return f"# {name}\n\n`import myomorph.{name}`\n\n::: myomorph.{name}\n"


def room_index(room: str) -> str:
    """List the modules of a room, each with the first line of its docstring."""
    lines = [
        f"# {room}",
        "",
        _first_line(PACKAGE / room / "__init__.py"),
        "",
        "| module | what it is for |",
        "|---|---|",
    ]
    for module in modules(room):
        name = module.relative_to(PACKAGE / room).with_suffix("").as_posix()
        lines.append(f"| [{name.replace('/', '.')}]({name}.md) | {_first_line(module)} |")
    return "\n".join(lines) + "\n"


def reference_index() -> str:
    """List the wings, from the main job outwards."""
    lines = [
        "# Modules",
        "",
        (
            "What every module offers, taken from its docstrings. The laboratory stands on the"
            " body, the body on the core, and the other wings on these; [Architecture]"
            "(../architecture.md) has the map and the values that pass between rooms."
        ),
        "Names that begin with an underscore are private and left out.",
        "",
        "| wing | what it is for | modules |",
        "|---|---|---|",
    ]
    for room in WINGS:
        told = _first_line(PACKAGE / room / "__init__.py")
        lines.append(f"| [{room}]({room}/index.md) | {told} | {len(modules(room))} |")
    return "\n".join(lines) + "\n"


def _first_line(module: Path) -> str:
    """First line of a module's docstring, fit for a table."""
    told = ast.get_docstring(ast.parse(module.read_text(encoding="utf-8"))) or ""
    return told.split("\n\n")[0].replace("\n", " ").replace("|", r"\|")
