"""The studies of maps, as the command line runs them."""

from __future__ import annotations

from pathlib import Path

import pytest

from omnilab.runner.run_folder import load_run

pytestmark = pytest.mark.slow  # whole runs

WORLD = Path(__file__).parents[1] / "box_world.yaml"
SMALL = [f"sensor.world={WORLD}", "sensor.size=96", "sensor.samples=1"]


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    return tmp_path_factory.mktemp("maps")


def test_local_maps_end_in_tables(omnilab_at, here):
    radon = [f"{of}.{side}" for of in ("descriptor", "descriptors.radon") for side in ("offsets=48", "angles=60")]
    arguments = ["study.steps_m=[0.4]", "study.neighbours=[5,9]", "study.query_count=12", "study.starts=2"]
    arguments += ["descriptors.radon_gist=null", "distances.poc=null", "distances.euclidean=null"]
    result = omnilab_at(here, "experiment=local_map", *SMALL, *radon, *arguments)
    assert result.rc == 0, result.stderr
    folder = here / "logs" / "latest"
    rows = load_run(folder).table("local_maps")
    made = {(row["method"], row["localizer"]) for row in rows}
    assert made == {(c, m) for c in ("radon + poc_band", "fourier_signature + cityblock") for m in ("spring", "smacof")}
    assert all(0 < float(row["median_m"]) < 2 and 0 < float(row["stress"]) < 1 for row in rows)
    assert len(load_run(folder).table("errors")) == len(rows) * 12 * 2
    files = ("times.csv", "errors_spring.png", "errors_smacof.png", "times.png", "maps.png", "run.rrd", "run.mcap")
    assert all((folder / name).stat().st_size > 0 for name in files)


def test_topological_maps_end_in_a_table(omnilab_at, here):
    arguments = ["study.steps_m=[0.3]", "study.nodes=[6,5]", "descriptors.hog=null", "descriptors.gist=null"]
    arguments += ["distances.pearson=null", "descriptors.radon.offsets=48", "descriptors.radon.angles=60"]
    result = omnilab_at(here, "experiment=topological_map", *SMALL, *arguments)
    assert result.rc == 0, result.stderr
    folder = here / "logs" / "latest"
    rows = load_run(folder).table("topological_maps")
    assert {row["method"] for row in rows} == {
        "radon + poc_band", "radon + cityblock", "fourier_signature + cityblock"
    }  # fmt: skip
    assert {(row["links"], row["localizer"]) for row in rows} == {(n, m) for n in "08" for m in ("spring", "smacof")}
    assert all(row["nodes"] == "30" for row in rows)
    assert min(float(row["rms_steps"]) for row in rows) < 2
    assert (folder / "maps_0.3_m.png").stat().st_size > 0
