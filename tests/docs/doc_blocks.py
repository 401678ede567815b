"""Fenced blocks of the documents, and a newcomer who types them: files are written, commands run, outputs compared."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[2]
PAGES = [
    *sorted((ROOT / "docs").rglob("*.md")),
    ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(ROOT.glob("plugins/*/README.md")),
]  # fmt: skip
FENCE = re.compile(
    r"^(?P<indent> *)```(?P<language>\w*)(?P<rest>[^\n]*)\n(?P<text>.*?)^(?P=indent)```", re.DOTALL | re.MULTILINE
)


class Block(NamedTuple):
    """A fenced block of a page: its language, the title (the name of a file) and the text."""

    page: str
    line: int
    language: str
    title: str
    text: str

    @property
    def place(self) -> str:
        return f"{self.page}:{self.line}"

    @property
    def lines(self) -> list[str]:
        """Commands, those that go on in the next line put together."""
        return [line for line in self.text.replace("\\\n", " ").splitlines() if line.strip()]


def blocks_of(path: Path) -> list[Block]:
    """All blocks of a page, in order."""
    text, page = path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix()
    return [
        Block(
            page,
            text.count("\n", 0, found.start()) + 1,
            found["language"],
            "".join(re.findall(r'title="([^"]+)"', found["rest"])),
            found["text"],
        )
        for found in FENCE.finditer(text)
    ]


def all_blocks() -> list[Block]:
    """Of every page."""
    return [block for path in PAGES for block in blocks_of(path)]


def commands(block: Block) -> Iterator[list[str]]:
    """The words of each `omnilab` command in a block, without what stands before it."""
    for command in re.split(r" && |\n", "\n".join(block.lines)):
        if found := re.match(r"(?:[A-Z_]+=\S+ |uv run )*omnilab(?: (.*))?$", command):
            yield shlex.split(found[1] or "", comments=True)


class Newcomer:
    """Types the blocks of a page in a folder, in order: `omnilab` in this process, anything else in a shell."""

    def __init__(self, folder: Path, omnilab: Callable[..., Any], setenv: Callable[[str, str], None]) -> None:
        self.folder, self._omnilab, self._setenv = folder, omnilab, setenv
        self.printed = ""

    def type(self, block: Block) -> None:
        """One block; an AssertionError where it does not do what the page says."""
        if block.language == "sh":
            self.printed = "".join(self._run(line) for line in block.lines)
        elif block.language == "console":
            self._answered(block)
        elif block.language == "text" and not block.title:
            self._compare(block)
        elif block.title and block.language != "text":
            file = self.folder / block.title
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            exec(compile(block.text, block.place, "exec"), {})

    def _run(self, line: str) -> str:
        words = shlex.split(line, comments=True)
        if words[0] == "export":
            self._setenv(*words[1].split("=", 1))
            return ""
        if words[0] == "omnilab":
            done = self._omnilab(*words[1:])
            assert done.rc == 0, (line, done.stderr)
            return str(done.stdout + done.stderr)
        words[0] = sys.executable if words[0] == "python" else words[0]
        ran = subprocess.run(words, cwd=self.folder, capture_output=True, text=True, timeout=200, check=False)
        assert ran.returncode == 0, (line, ran.stdout + ran.stderr)
        return ran.stdout

    def _answered(self, block: Block) -> None:
        """Commands behind a $, each refused in the sentences below it, where ... stands for anything."""
        for session in re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]:
            line, *sentences = session.splitlines()
            words = shlex.split(line)
            variable = words.pop(0).split("=", 1) if words[0].startswith("OMNILAB_") else ["OMNILAB_PLUGINS", ""]
            self._setenv(*variable)
            done = self._omnilab(*words[1:])
            assert done.rc == 2, (line, done)
            for sentence in sentences:
                pattern = ".*".join(re.escape(part) for part in sentence.split("..."))
                assert re.search(f"^{pattern}$", done.stderr, flags=re.MULTILINE), (line, done.stderr)

    def _compare(self, block: Block) -> None:
        """Every line of the page's output was printed, but for numbers, names of runs and rules."""
        printed = {without_numbers(line) for line in self.printed.splitlines()}
        for line in block.lines:
            assert "──" in line or without_numbers(line) in printed, (block.place, line, self.printed)


def without_numbers(line: str) -> str:
    """A line of output with what another run or machine has otherwise replaced by 0."""
    words = re.sub(r"\d{4}(-\d\d){2}_(\d\d-){3}[0-9a-f]{6}", "0", " ".join(line.split()))
    return re.sub(r"[-+]?\d[\d.]*(e[-+]?\d+)?", "0", words)
