"""The files of a new component, made of templates."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.resources import files
from importlib.resources.abc import Traversable

from omnilab import __version__
from omnilab.api import CONTRACT_VERSION, KINDS

RUNS = {  # a short run of a component NAME of each kind
    "sensor": "sensor=NAME",
    "disturbance": "disturbance=NAME",
    "descriptor": "descriptor=NAME",
    "distance": "distance=NAME",
    "localizer": "localizer=NAME",
    "altimeter": "study=altitude altimeter=NAME",
    "odometry": "study=trajectory odometry=NAME loop_closure=none backend=gtsam_isam2",
    "loop_closure": "study=trajectory odometry=simulated loop_closure=NAME backend=gtsam_isam2",
    "backend": "experiment=pose_graph backend=NAME",
    "view_filter": "study=view_range view_filter=NAME study.seeds=5 'study.ranges_m=[6,9]'",
    "study": "study=NAME",
    "sink": "+sink@sinks.NAME=NAME",
}
PYTHON = ">=3.11,<3.14"
HOOK = '''\
CONTRACT = "{version}"  # of omnilab, for which this is written


@hookimpl
def {hook}(register: Register) -> None:
    """What `{kind}={name}` names."""
    register("{name}", {cls})
'''
FOLDERS = '''

@hookimpl
def register_folders(register: RegisterFolder) -> None:
    """Where recipes lie, as `experiment/NAME.yaml`: beside this file."""
    register(".")
'''
IMPORTED = re.compile(r"^from omnilab import \(\n(.*?)^\)", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class NewComponent:
    """A component to be made: its kind and its name."""

    kind: str
    name: str

    @property
    def cls(self) -> str:
        """The name of its class: `SkyLine` of `sky_line`."""
        return "".join(part.capitalize() for part in self.name.split("_"))

    @property
    def package(self) -> str:
        return f"omnilab_{self.name}"

    @property
    def distribution(self) -> str:
        return self.package.replace("_", "-")

    @property
    def run(self) -> str:
        """The overrides of a short run of it."""
        return RUNS[self.kind].replace("NAME", self.name)


def single_file(component: NewComponent) -> dict[str, str]:
    """A module that is a plugin by itself, and its tests, by file name."""
    source = _with_names(_component(component), ("Register", "hookimpl"))
    return {
        f"{component.name}.py": f"{source}\n\n{_hook(component)}",
        f"test_{component.name}.py": _tests(component, component.name),
    }


def distribution(component: NewComponent, author: str) -> dict[str, str]:
    """The files of a distribution, by their paths in its folder."""
    source = f"src/{component.package}"
    made = {
        f"{source}/{component.name}.py": _component(component),
        f"{source}/py.typed": "",
        f"tests/test_{component.name}.py": _tests(component, component.package),
    }
    paths = {
        "pyproject.toml": "pyproject.toml",
        "README.md": "README.md",
        "LICENSE": "LICENSE",
        "gitignore": ".gitignore",
        "tests.yml": ".github/workflows/tests.yml",
        "init.py": f"{source}/__init__.py",
    }
    if component.kind == "study":
        paths["recipe.yaml"] = f"{source}/experiment/{component.name}.yaml"
    words = _words(component, author)
    for template, path in paths.items():
        text = _template("distribution", f"{template}.txt")
        made[path] = re.sub(r"@([A-Z_]+)@", lambda found: words[found[1]], text)
    return made


def recipe(name: str) -> str:
    """A recipe of a small experiment."""
    return _template("distribution", "small_recipe.yaml.txt").replace("@NAME@", name)


def identifiers(kind: str) -> set[str]:
    """The words in the templates of a kind, which a class cannot be called."""
    source = _template("components", f"{kind}.py") + _template("checks", f"{kind}.py")
    return set(re.findall(r"\w+", source))


def _words(component: NewComponent, author: str) -> Mapping[str, str]:
    """What stands for @WORD@ in the templates of a distribution."""
    protocol = KINDS[component.kind].protocol
    summary = _summary(component)
    return {
        "NAME": component.name,
        "CLASS": component.cls,
        "PACKAGE": component.package,
        "DISTRIBUTION": component.distribution,
        "KIND": component.kind,
        "KIND_WORDS": component.kind.replace("_", " "),
        "PROTOCOL": protocol.__name__,
        "RUN": component.run,
        "IMPORTED": "Register, RegisterFolder, hookimpl" if component.kind == "study" else "Register, hookimpl",
        "HOOKS": (_hook(component) + FOLDERS * (component.kind == "study")).rstrip(),
        "SUMMARY": summary,
        "SUMMARY_QUOTED": json.dumps(summary),
        "AUTHOR": author,
        "AUTHOR_QUOTED": json.dumps(author),
        "YEAR": str(datetime.now(UTC).year),
        "OMNILAB": ".".join(__version__.split(".")[:2]),
        "PYTHON": PYTHON,
    }


def _hook(component: NewComponent) -> str:
    hook = KINDS[component.kind].hook
    return HOOK.format(version=CONTRACT_VERSION, hook=hook, kind=component.kind, name=component.name, cls=component.cls)


def _component(component: NewComponent) -> str:
    """The module of a component, without what registers it."""
    return _renamed(_template("components", f"{component.kind}.py"), component)


def _tests(component: NewComponent, module: str) -> str:
    """Its tests, which import it after all others: it is the one module of its own."""
    source = _renamed(_template("checks", f"{component.kind}.py"), component)
    lines = [line for line in source.splitlines() if ".templates." not in line]
    last = max(i for i, line in enumerate(lines) if line.startswith(("import ", "from ")))
    lines[last + 1 : last + 1] = ["", f"from {module} import {component.cls}"]
    return "\n".join(lines) + "\n"


def _summary(component: NewComponent) -> str:
    """The first line of the class's docstring."""
    found = re.search(r'^class \w+:\n    """(.*?)(?:"""|\n)', _component(component), re.MULTILINE)
    assert found
    return inspect.cleandoc(found[1])


def _renamed(source: str, component: NewComponent) -> str:
    """The source with the names of the component instead of those of the template."""
    placeholder = NewComponent(component.kind, f"my_{component.kind}")
    return source.replace(placeholder.cls, component.cls).replace(placeholder.name, component.name)


def _with_names(source: str, more: tuple[str, ...]) -> str:
    """The source, importing more names from omnilab: classes first, each sorted, as ruff has them."""
    found = IMPORTED.search(source)
    assert found
    names = [*re.findall(r"\w+", found[1]), *more]
    names.sort(key=lambda name: (name[0].islower(), name.lower()))
    listed = "".join(f"    {name},\n" for name in names)
    return source[: found.start(1)] + listed + source[found.end(1) :]


def _template(folder: str, file: str) -> str:
    root: Traversable = files("omnilab.runner.authoring.templates")
    return (root / folder / file).read_text(encoding="utf-8")
