"""A map and queries that do not belong together: said in a sentence, and what it proposes works."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omnilab.runner.run_folder import load_run

pytestmark = pytest.mark.slow  # whole runs

WORLD = Path(__file__).parents[1] / "box_world.yaml"
QUIET = ["~sink@sinks.rerun", "~sink@sinks.mcap", "cache=off", "study.show=1"]
ROOM = [f"sensor.world={WORLD}", "sensor.samples=1"]
WIDE = ["sensor=equirectangular", "sensor.width=64", "sensor.height=32", *ROOM]


@pytest.fixture
def made(omnilab_here: Callable[..., Any], tmp_path: Path) -> Path:
    """A map by panoramas."""
    done = omnilab_here("experiment=map", *WIDE, "descriptor=fourier_signature", "study.step_m=1", *QUIET)
    assert done.rc == 0, done.stderr
    return (tmp_path / "logs/latest").resolve()


def test_queries_by_another_camera(omnilab_here: Callable[..., Any], made: Path) -> None:
    queries = ["experiment=localize", f"map={made}", "study.query_count=6", *QUIET]
    mirror = [*ROOM, "sensor.size=48"]
    refused = omnilab_here(*queries, *mirror)
    assert refused.rc == 2
    assert "the map was made by an EquirectangularCamera, these queries by a HyperbolicMirror" in refused.stderr
    assert "study.other_pictures=true" in refused.stderr
    meant = omnilab_here(*queries, *mirror, "study.other_pictures=true")
    assert meant.rc == 0
    assert "the map was made by an EquirectangularCamera, these queries by a HyperbolicMirror" in meant.stderr
    same = omnilab_here(*queries, *WIDE)
    assert same.rc == 0
    assert "the map" not in same.stderr
    assert load_run(Path("logs/latest")).metrics["nearest_rate"] > 0.4


def test_a_map_of_before_its_pictures_were_kept(omnilab_here: Callable[..., Any], made: Path) -> None:
    with np.load(made / "map.npz") as archive:
        arrays = dict(archive)
    about = str(arrays["about"])
    start = about.index('"provenance"')
    end = about.index("}", start) + 3
    np.savez(made / "map.npz", **arrays | {"about": np.array(about[:start] + about[end:])})
    found = omnilab_here("experiment=localize", f"map={made}", "study.query_count=6", *WIDE, *QUIET)
    assert found.rc == 0, found.stderr
    assert "cannot be told" in found.stderr


def test_a_map_of_recorded_images_finds_each_of_them(omnilab_here: Callable[..., Any], tmp_path: Path) -> None:
    import cv2

    rng = np.random.default_rng(0)
    rows = ["image,x_m,y_m"]
    for i in range(6):
        image = cv2.resize(rng.integers(0, 255, (8, 8), dtype=np.uint8), (64, 64), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(tmp_path / f"{i}.png"), image)
        rows.append(f"{i}.png,{i % 3},{i // 3}")
    (tmp_path / "positions.csv").write_text("\n".join(rows) + "\n")
    recorded = [
        "sensor=folder",
        f"sensor.path={tmp_path}",
        "sensor.pattern=*.png",
        "sensor.circle_px=[32,32,30]",
        *QUIET,
    ]
    for layout in (["study.places=recorded"], ["study.step_m=null", "study.every=1"]):
        done = omnilab_here("experiment=map", *recorded, *layout)
        assert done.rc == 0, done.stderr
    found = omnilab_here("experiment=localize", "map=logs/latest", *recorded, "study.queries=recorded")
    assert found.rc == 0, found.stderr
    assert load_run(tmp_path / "logs/latest").metrics["nearest_rate"] == 1
