"""A page for each recipe: what it does, its command, components and settings, and what was measured with it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from omnilab.api import KINDS
from omnilab.runner.plugins.folders import own_recipes
from omnilab.runner.site.texts import Sources, manual, table

CHOICE = re.compile(rf"^ *- (?:override )?/?({'|'.join(KINDS)})(?:@[\w.]+)?: *\[?([\w, ]+)\]?", re.MULTILINE)


@dataclass(frozen=True)
class Recipe:
    """A file of conf/experiment."""

    name: str
    text: str

    @property
    def comment(self) -> str:
        """What its author says of it."""
        head = self.text.partition("\ndefaults:")[0].splitlines()
        return "\n".join(line.removeprefix("#").strip() for line in head if not line.startswith("# @package")).strip()

    @property
    def summary(self) -> str:
        """Its first sentence."""
        return re.split(r"(?<=[.:]) ", " ".join(self.comment.split()))[0].rstrip(":.") + "."

    @property
    def components(self) -> list[tuple[str, str]]:
        """Kind and name of those that it chooses."""
        return [(kind, name.strip()) for kind, names in CHOICE.findall(self.text) for name in names.split(",")]

    @property
    def study(self) -> str:
        """The study that it runs."""
        return next((name for kind, name in self.components if kind == "study"), "grid")


def shipped_recipes() -> list[Recipe]:
    """All there are, by name."""
    return [Recipe(name, file.read_text(encoding="utf-8")) for name, file in own_recipes().items()]


def recipe_pages(known: dict[tuple[str, str], str], found: list[Recipe], sources: Sources) -> Iterator[tuple[str, str]]:
    """Path and text of each recipe's page; `known` are the paths of the components' pages."""
    for recipe in found:
        yield f"recipes/{recipe.name}.md", page(recipe, known, sources)


def page(recipe: Recipe, known: dict[tuple[str, str], str], sources: Sources) -> str:
    """The page of one."""
    parts = [f"# {recipe.name}\n", manual(recipe.comment) + "\n", f"```\nomnilab experiment={recipe.name}\n```\n"]
    if picture := sources.picture("study", recipe.study):
        parts.append(f"![A run of the study {recipe.study}](../{picture})\n")
    rows = [[kind, f"[`{name}`](../{known[kind, name]})"] for kind, name in recipe.components if (kind, name) in known]
    if rows:
        parts += ["## Components\n", table(["kind", "component"], rows)]
    parts += [
        "## Settings\n",
        f"The whole configuration: `omnilab experiment={recipe.name} --cfg job`. The recipe itself:\n",
    ]
    parts += [f"```yaml\n{recipe.text.strip()}\n```\n"]
    parts += _measured(recipe.name, sources.pages.get("fidelity.md", ""))
    if pages := sources.that_name(rf"experiment={recipe.name}\b", but=["experiments.md"]):
        parts += ["## Read on\n", "\n".join(f"- {link}" for link in pages) + "\n"]
    return "\n".join(parts)


def _measured(name: str, fidelity: str) -> list[str]:
    runs, rows = measurements(name, fidelity)
    if not rows:
        return []
    head = ["claim", "reported", "holds if", "its protocol", "variant", "verdict", "runs"]
    words = "What publications claim and runs of this recipe measured ([all of them](../fidelity.md)):\n"
    return ["## Measured\n", words, table(head, rows), *(f"- {run}: `{command}`" for run, command in runs.items()), ""]


def measurements(name: str, fidelity: str) -> tuple[dict[str, str], list[list[str]]]:
    """Of docs/fidelity.md the commands of a recipe's runs, by the names of runs, and the rows of claims that they measured."""
    commands = re.findall(r"^\| (\w+) \| `(omnilab [^`]*)` \|", fidelity, flags=re.MULTILINE)
    runs = {run: command for run, command in commands if re.search(rf"experiment={name}(?!\w)", command)}
    rows = [re.split(r"(?<!\\) \| ", line.strip("| ")) for line in fidelity.splitlines() if line.startswith("| `")]
    return runs, [[each.replace("\\|", "|") for each in row] for row in rows if runs.keys() & set(row[-1].split(", "))]


def recipes_index(found: list[Recipe]) -> str:
    """The page that lists them, study by study."""
    parts = ["# Recipes\n", "A recipe picks a study and components: `omnilab experiment=NAME`. By study:\n"]
    for study in sorted({recipe.study for recipe in found}):
        rows = [[f"[`{r.name}`]({r.name}.md)", manual(r.summary)] for r in found if r.study == study]
        parts += [f"## {study}\n", table(["recipe", "what it does"], rows)]
    return "\n".join(parts)
