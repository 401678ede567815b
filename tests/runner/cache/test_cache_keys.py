"""Keys of descriptions on disk: whatever could change a signature changes its key."""

from __future__ import annotations

import ast
from dataclasses import replace
from importlib.metadata import packages_distributions
from pathlib import Path

import numpy as np
import pytest

import omnilab.runner.cache.disk_cache as cache_module
import omnilab.runner.fingerprint as fingerprint_module
from omnilab.runner.fingerprint import fingerprint


@pytest.fixture
def known(probe, cache, images, tmp_path, made_anew):
    """Descriptions by one descriptor, with a model in a file."""
    model = tmp_path / "model.bin"
    model.write_bytes(b"weights")
    descriptor = probe.Rows(model=str(model))
    assert made_anew(cache, descriptor, images) == 10
    assert made_anew(cache, descriptor, images) == 0
    return descriptor


def test_a_pixel_is_part_of_the_key(known, cache, images, made_anew):
    images[3, 5, 7] ^= 1
    assert made_anew(cache, known, images) == 1


def test_the_shape_is_part_of_the_key(known, cache, images, made_anew):
    assert made_anew(cache, known, images.reshape(10, 16, 12)) == 10


def test_the_type_is_part_of_the_key(known, cache, images, made_anew):
    assert made_anew(cache, known, images.view(np.int8)) == 10


def test_a_setting_is_part_of_the_key(known, cache, images, made_anew):
    assert made_anew(cache, replace(known, power=2), images) == 10


def test_the_content_of_a_file_that_a_setting_names_is_part_of_the_key(known, cache, images, made_anew):
    Path(known.model).write_bytes(b"weighty")
    assert made_anew(cache, known, images) == 10


def test_the_class_is_part_of_the_key(known, cache, images, probe, made_anew):
    assert made_anew(cache, probe.Twin(model=known.model), images) == 10


@pytest.mark.parametrize("file", ["{0}/__init__.py", "{0}/table.csv", "{0}_helper.py"])
def test_source_code_is_part_of_the_key(known, cache, images, probe, file, made_anew):
    """Its package, whatever the file, and what the package imports from a source tree."""
    path = Path(probe.__file__).parent.parent / file.format(probe.__name__)
    path.write_text((path.read_text() if path.exists() else "") + "\n# edited\n")
    assert made_anew(cache, known, images) == 10


def test_a_file_of_a_package_that_is_no_module_does_no_harm(known, cache, images, probe, made_anew):
    Path(probe.__file__).with_name("template.py").write_text("from {{ this }} import that")
    assert made_anew(cache, known, images) == 10


@pytest.mark.parametrize("name", ["numpy", "omnilab", "opencv-python-headless"])
def test_versions_are_part_of_the_key(known, cache, images, monkeypatch, name, made_anew):
    true = fingerprint_module.version
    monkeypatch.setattr(fingerprint_module, "version", lambda asked: "99" if asked == name else true(asked))
    assert made_anew(cache, known, images) == 10


def test_the_versions_of_all_that_shipped_descriptors_compute_with_are_in_their_keys():
    from omnilab_appearance import Radon

    first_words = {line.partition(" ")[0] for line in fingerprint(Radon()).splitlines()}
    assert {"numpy", "scipy", "numba", "opencv-python-headless", "omnilab", "omnilab-appearance"} <= first_words


IMPORTS = """\
import a1
import a2.deep, a3 as other, \\
    a4
from a5 import x
from a6.deep import (x,
    y)
if True: import a7
x = 1; from a8 import x
def f():
\timport a9
try:
    from .near import x
    from . import near
except ImportError: import b1; import b2
from \\
    b3 import x
"""


def test_all_ways_to_write_an_import_are_read(tmp_path, monkeypatch):
    """As Python's own parser reads them, and no others here."""
    path = tmp_path / "module.py"
    path.write_text("\ufeff" + IMPORTS)
    monkeypatch.setattr(fingerprint_module, "_files", lambda top: [path])
    found = set[str]()
    for node in ast.walk(ast.parse(IMPORTS)):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add(node.module.partition(".")[0])
    assert fingerprint_module._imports("module") == found
    assert len(found) == 12


def test_names_are_of_the_distributions_that_importlib_says():
    ours = {top: sorted({found.name for found in of}) for top, of in fingerprint_module._distributions().items()}
    assert ours == {top: sorted(set(of)) for top, of in packages_distributions().items()}


@pytest.mark.parametrize("what", ["python_version", "machine"])
def test_python_and_the_machine_are_part_of_the_key(known, cache, images, monkeypatch, what, made_anew):
    monkeypatch.setattr(fingerprint_module.platform, what, lambda: "another")
    assert made_anew(cache, known, images) == 10


def test_the_number_of_threads_is_part_of_the_key(known, cache, images, made_anew):
    assert made_anew(cache, known, images, threads=2) == 10


def test_the_format_is_part_of_the_key(known, cache, images, monkeypatch, made_anew):
    monkeypatch.setattr(cache_module, "FORMAT", cache_module.FORMAT + 1)
    assert made_anew(cache, known, images) == 10
