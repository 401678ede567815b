"""The command that makes docs/real_images.md: without the data it says so, and what it says follows from the runs."""

import importlib.util
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "docs/real_images.py"


@pytest.fixture(scope="module")
def real_images():
    spec = importlib.util.spec_from_file_location("real_images", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_without_the_data_it_says_so_and_leaves_the_page(real_images, tmp_path, capsys):
    page = SCRIPT.with_suffix(".md")
    before = page.read_bytes() if page.exists() else None
    assert real_images.main([str(tmp_path), str(tmp_path / "runs")]) == 2
    said = capsys.readouterr().err
    assert f"{tmp_path} lacks sussex_route, cycloid_ceiling, bearingnet_forest_grid" in said
    assert "omnilab dataset list sussex_route says where" in said
    assert (page.read_bytes() if page.exists() else None) == before
    assert not (tmp_path / "runs").exists()


def row(method, error_m):
    return {
        "method": method,
        "localizer": "nearest",
        "position_error_median_m": "0.1",
        "position_error_p90_m": str(error_m),
    }


def test_what_fails_is_what_shone_in_the_virtual_world(real_images):
    names = ("fourier_signature", "fourier_means", "gist", "gist_coarse", "hog", "hog_grid")
    real = [row(name, 0.9 if name == "hog" else 0.1) for name in names]
    virtual = [row(name, 0.4) for name in ("fourier_signature", "hog", "gist")]
    text = real_images.failures(real, virtual, 0.15, 1.0)
    assert "**`hog`** shine" in text
    assert "| hog | 0.40 | 6.00 | fails |" in text
    assert "| fourier_signature | 0.40 | 0.67 |  |" in text
