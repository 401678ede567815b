"""Descriptors that a test can edit, and caches of what they describe."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import omnilab.runner.fingerprint as fingerprint_module
from omnilab.runner.cache import DiskCache

LIMIT = 10**9
SOURCE = '''
from dataclasses import dataclass
import numpy as np
from omnilab.api import Signatures
from {name}_helper import FACTOR

@dataclass
class Rows:
    """Means of the rows, and of the columns."""
    power: int = 1
    model: str = ""
    view, color, rotation, default_distance = "panorama", False, "invariant", "euclidean"
    def __post_init__(self):
        self.batches = []  # a copy counts along
    def describe(self, images):
        self.batches.append(len(images))
        rows, columns = (images.mean(axis, dtype=np.float32) for axis in (2, 1))
        return Signatures(FACTOR * rows**self.power, columns)

@dataclass
class Twin(Rows):
    """The same under another name."""

@dataclass
class Moody(Rows):
    """Whose signatures lie in another order in memory."""
    def describe(self, images):
        found = super().describe(images)
        return Signatures(np.asfortranarray(found.place), found.heading)

@dataclass
class Secret(Rows):
    """Which says that it must not be kept."""
    cached = False

@dataclass
class Taught(Rows):
    """Which learns."""
    def fit(self, images):
        return self

    def restore(self, state):
        return self
'''


@pytest.fixture
def probe(tmp_path, monkeypatch):
    """A package with descriptors, and a module that it imports."""
    name = f"probe_{tmp_path.name.replace('-', '_')}"
    package = tmp_path / "source" / name
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(SOURCE.format(name=name))
    (package.parent / f"{name}_helper.py").write_text("FACTOR = 2\n")
    monkeypatch.syspath_prepend(package.parent)
    yield importlib.import_module(name)
    for module in (name, f"{name}_helper"):
        del sys.modules[module]
    forget()


def forget():
    """As a new process would begin."""
    fingerprint_module._source.cache_clear()
    fingerprint_module._processor.cache_clear()


@pytest.fixture
def cache(tmp_path):
    """`cache()`: what another run would have."""
    return lambda limit=LIMIT, threads=1: DiskCache(tmp_path / "cache", limit, threads)


@pytest.fixture
def images():
    return np.random.default_rng(0).integers(0, 256, (10, 12, 16), dtype=np.uint8)


@pytest.fixture
def made_anew():
    """`made_anew(cache, descriptor, images, limit=..., threads=...)`: how many images a new process describes."""

    def made_anew(cache, descriptor, images, **settings):
        forget()
        store = cache(**settings)
        store.wrap(descriptor).describe(images)
        return store.made["describe"]

    return made_anew


@pytest.fixture
def imported() -> Iterator[Callable[[Path], ModuleType]]:
    """`imported(file)`: the module of a file, which pickle finds for as long as the test lasts."""
    names = []

    def imported(file: Path) -> ModuleType:
        spec = importlib.util.spec_from_file_location(file.stem, file)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module
        names.append(spec.name)
        spec.loader.exec_module(module)
        return module

    yield imported
    for name in names:
        del sys.modules[name]
