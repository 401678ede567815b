"""Runs with plugins that break the contract: exit code 2, one sentence with plugin and component, a true status."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from omnilab.runner.run_folder import load_run

PLUGIN = '''
from dataclasses import dataclass
import numpy as np
from omnilab import hookimpl
from omnilab.api import Estimates, Match, Report, Signatures
from omnilab_appearance.distances import Euclidean
from omnilab_appearance.localizers import Nearest

class Panic(BaseException):
    """As libraries of other languages raise it."""

@dataclass
class Bad:
    """A descriptor."""
    view, color, rotation, default_distance = "panorama", False, {rotation!r}, "euclidean"
    def __post_init__(self): {init}
    def describe(self, images):
        place = images[:, ::16, ::64].astype(np.float32)
        {describe}
        return Signatures(place)

@dataclass
class BadDistance(Euclidean):
    """A distance."""
    def match(self, queries, index):
        found = super().match(queries, index)
        {match}
        return found

@dataclass
class BadLocalizer(Nearest):
    """A localizer."""
    def locate(self, queries, index):
        found = super().locate(queries, index)
        {locate}
        return found

@dataclass
class BadStudy:
    """A study, with the settings of the recipe."""
    step_m: float | None = None
    every: int = 2
    queries: str = "rest"
    needs = ()
    def run(self, parts, record, rng):
        {study}

@hookimpl
def register_descriptors(register): register("bad", Bad)
@hookimpl
def register_distances(register): register("bad", BadDistance)
@hookimpl
def register_localizers(register): register("bad", BadLocalizer)
@hookimpl
def register_studies(register): register("bad", BadStudy)
'''
SOUND = dict.fromkeys(("init", "describe", "match", "locate", "study"), "pass") | {"rotation": "none"}


@pytest.fixture
def run(omnilab_here: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """`run(*arguments, describe=..., ...)`: a small run with the plugin so spoilt, on a grid of nine pictures."""

    def run(*arguments: str, **spoilt: str) -> Any:
        (tmp_path / "bad.py").write_text(PLUGIN.format(**SOUND | spoilt), encoding="utf-8")
        (tmp_path / "data").mkdir()
        rng = np.random.default_rng(3)
        names = [f"{i}.png" for i in range(9)]
        for name in names:
            picture = rng.integers(0, 1 if "black" in spoilt else 256, (48, 48), dtype=np.uint8)
            cv2.imwrite(str(tmp_path / "data" / name), picture)
        rows = [f"{name},{i % 3},{i // 3}" for i, name in enumerate(names)]
        (tmp_path / "data/positions.csv").write_text("\n".join(["image,x_m,y_m", *rows]), encoding="utf-8")
        monkeypatch.setenv("OMNILAB_PLUGINS", "bad.py")
        return omnilab_here(
            "experiment=recorded_grid",
            "sensor.path=data",
            "sensor.circle_px=[24,24,23]",
            *QUIET["black" in spoilt :],
            *arguments,
        )

    return run


QUIET = ("~sinks.console", "~sinks.rerun", "~sinks.mcap")


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("spoilt", "chosen", "expected"),
    [
        ({"describe": "place[0, 0, 0] = np.nan"}, "descriptor", "(image number 0 is "),
        ({"describe": "raise Panic('in Rust')"}, "descriptor", "tried to end the process (Panic: in Rust)"),
        ({"rotation": "spins"}, "descriptor", "declares rotation='spins'"),
        ({"study": "return None"}, "study", "run returns None, not Report"),
        pytest.param({"describe": "place[1:] = np.inf"}, "descriptor", "in 3 of 4 images", marks=SLOW),
        pytest.param({"describe": "return None"}, "descriptor", "describe returns None, not Signatures", marks=SLOW),
        pytest.param({"describe": "raise SystemExit(7)"}, "descriptor", "the process (SystemExit: 7)", marks=SLOW),
        pytest.param({"match": "found.distance[:] = np.nan"}, "distance", "in `distance` (100 %", marks=SLOW),
        pytest.param({"match": "found = Match(found.distance[:, 1:])"}, "distance", "(5, 3), not (5, 4)", marks=SLOW),
        pytest.param({"locate": "found.place[:] = -1"}, "localizer", "`place` -1", marks=SLOW),
        pytest.param({"study": "raise SystemExit(0)"}, "study", "the process (SystemExit: 0)", marks=SLOW),
    ],
)
def test_a_run_with_a_bad_plugin_fails(run: Any, spoilt: Any, chosen: str, expected: str, tmp_path: Path) -> None:
    components = [f"{kind}=bad" for kind in dict.fromkeys(("descriptor", chosen))]
    rc, out, err = run(*components, **spoilt)
    assert (rc, out) == (2, "")
    assert err.startswith(f"omnilab: {chosen} 'bad' of plugin 'bad' (bad.py)")
    assert expected in err
    assert err.count("\n") == 1
    if "rotation" not in spoilt:  # which is refused before anything is run
        failed = load_run(tmp_path / "logs/latest")
        assert failed.state == "failed"
        assert failed.status["error"].removeprefix("PluginError: ") in err or "SystemExit" in failed.status["error"]
        assert failed.metrics == {}


@pytest.mark.parametrize("end", ["SystemExit(3)", "Panic('in Rust')"])
def test_a_component_that_would_end_the_process_while_it_is_made(run: Any, end: str, tmp_path: Path) -> None:
    rc, out, err = run("descriptor=bad", init=f"raise {end}")
    assert (rc, out) == (2, "")
    file = tmp_path / "bad.py"
    assert err.startswith(f"omnilab: a component that was being made, in {file}, tried to end the process (")
    assert err.count("\n") == 1
    assert list((tmp_path / "logs/recorded_grid").iterdir()) == []


def test_signatures_that_are_not_finite_are_not_kept(run: Any, tmp_path: Path) -> None:
    assert run("descriptor=bad", describe="place[0] = np.nan").rc == 2
    assert list((tmp_path / "logs/cache").rglob("*.npz")) == []


@pytest.mark.slow
def test_black_pictures_win_no_metric_and_are_told(run: Any, tmp_path: Path) -> None:
    rc, out, err = run("descriptor=radon", black="yes")
    assert rc == 0, err
    found = load_run(tmp_path / "logs/latest")
    assert found.metrics["nearest_rate"] == found.metrics["recall_at_1"] == 1 / 5  # the query in the middle of all four
    assert found.metrics["average_precision"] == pytest.approx(1 / 25)
    assert math.isnan(found.metrics["heading_error_median"])
    assert found.notes["heading_error_median"] == "nothing tells any answer from other places"
    warnings = (found.folder / "warnings.txt").read_text().splitlines()
    assert warnings[0].startswith("all 4 places of the map have equal signatures, as black or constant pictures have")
    assert warnings[1].startswith("all 5 queries have equal signatures")
    assert all(warning in err for warning in warnings)
    assert "nan" not in out + (found.folder / "metrics.csv").read_text()
