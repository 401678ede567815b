"""The plugin of MkDocs that adds the pages that are made, and leads links between files of the repository to pages."""

from __future__ import annotations

import re
from importlib.metadata import distribution, distributions
from pathlib import Path
from posixpath import normpath, relpath
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import BasePlugin
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from omnilab.runner.discovery import discover
from omnilab.runner.site.pages import made_pages, navigation

ELSEWHERE = {  # pages that are files of the repository outside docs/
    "README.md": "index.md",
    "CHANGELOG.md": "project/changelog.md",
    "CONTRIBUTING.md": "project/contributing.md",
    "SECURITY.md": "project/security.md",
}
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")


class SitePlugin(BasePlugin):  # type: ignore[type-arg, no-untyped-call]  # it has no settings
    """Registered as `omnilab` in the group mkdocs.plugins."""

    def on_files(self, files: Files, *, config: MkDocsConfig) -> Files:
        """Add the pages, and put them into the navigation."""
        registry, docs = discover(), Path(config.docs_dir)
        self._made, elsewhere = made_pages(registry, docs), documents_elsewhere(docs)
        for path, text in (self._made | elsewhere).items():
            files.append(File.generated(config, path, content=text))
        config.nav = _expanded(config.nav, lambda entry: navigation(entry, registry, self._made, elsewhere))
        return files

    def on_page_markdown(self, markdown: str, *, page: Page, files: Files, **_: Any) -> str:
        """Links of written pages, as they work in the repository, lead to pages; those to other files are words alone."""
        if page.file.src_uri in self._made:
            return markdown
        source = repository_path(page.file.src_uri)

        def led(match: re.Match[str]) -> str:
            picture, words, target = match.groups()
            if re.match(r"[a-z]+:|#", target):
                return match[0]
            path, _, anchor = target.partition("#")
            found = page_of(normpath(f"{Path(source).parent.as_posix()}/{path}"))
            if files.get_file_from_path(found) is None:
                return match[0] if picture else words
            return f"{picture}[{words}]({relpath(found, Path(page.file.src_uri).parent.as_posix())}{'#' * bool(anchor)}{anchor})"

        return LINK.sub(led, markdown)


def documents_elsewhere(docs: Path) -> dict[str, str]:
    """The texts of the pages that are files of the repository outside docs/: of the clone, or of what is installed.

    A wheel has the README of its distribution in its metadata, and the others of the root in share/doc/omnilab.
    """
    root = docs.parent
    if (root / "pyproject.toml").is_file():
        paths = [*root.glob("plugins/*/README.md"), *(root / path for path in ELSEWHERE if path != "README.md")]
        return {page_of(path.relative_to(root).as_posix()): path.read_text("utf-8") for path in paths}
    found = {}
    for each in distributions():
        if plugin := re.fullmatch(r"omnilab[-_](\w+)", each.name):
            found[page_of(f"plugins/{plugin[1]}/README.md")] = str(each.metadata.json.get("description", ""))
    for path in distribution("omnilab").files or []:
        if path.match("share/doc/omnilab/*.md"):
            found[page_of(path.name)] = path.read_text("utf-8")
    return found


def repository_path(page: str) -> str:
    """Of a page's source, where its links start from."""
    for path, own in ELSEWHERE.items():
        if own == page and path != "README.md":
            return path
    plugin = re.fullmatch(r"project/plugin_(\w+)\.md", page)
    return f"plugins/{plugin[1]}/README.md" if plugin else f"docs/{page}"


def page_of(path: str) -> str:
    """The page that a file of the repository is."""
    plugin = re.fullmatch(r"plugins/(\w+)/README\.md", path)
    return f"project/plugin_{plugin[1]}.md" if plugin else ELSEWHERE.get(path, path.removeprefix("docs/"))


def _expanded(entries: Any, pages: Any) -> Any:
    """The navigation with what stands for its entries that end in /."""
    if isinstance(entries, dict):
        return {title: _expanded(inner, pages) for title, inner in entries.items()}
    if not isinstance(entries, list):
        return entries
    found: list[Any] = []
    for entry in entries:
        found += pages(entry) if isinstance(entry, str) and entry.endswith("/") else [_expanded(entry, pages)]
    return found
