"""The studies linearity, cost and parameter_curves, as the command line runs them."""

from __future__ import annotations

from pathlib import Path

import pytest

from omnilab.runner.run_folder import load_run

pytestmark = pytest.mark.slow  # whole runs

WORLD = Path(__file__).parents[1] / "box_world.yaml"
TINY = Path(__file__).parents[1] / "third_party" / "omnilab_tiny.py"  # the descriptor of a stranger
SMALL = [
    f"sensor.world={WORLD}", "sensor.size=96", "sensor.samples=1", "descriptors.radon.offsets=48",
    "descriptors.radon.angles=60", "descriptors.radon_gist.offsets=48", "descriptors.radon_gist.angles=60",
]  # fmt: skip


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    return tmp_path_factory.mktemp("linearity")


def test_linearity_ends_in_one_table(omnilab_at, here):
    arguments = ["study.step_m=0.2", "study.reach_m=0.8", "study.references=4", "study.show=3"]
    arguments += [f"descriptors.{name}=null" for name in ("hog", "radon_gist", "fourier_signature", "gist_4")]
    arguments += [f"distances.{name}=null" for name in ("poc_squared", "log", "root", "euclidean")]
    result = omnilab_at(here, "experiment=linearity", *SMALL, *arguments)
    assert result.rc == 0, result.stderr
    folder = here / "logs" / "latest"
    rows = load_run(folder).table("linearity")
    pairs = {(row["descriptor"], row["distance"]) for row in rows}
    assert {("radon", "poc"), ("gist", "pearson"), ("fourier_signature_4", "weighted")} <= pairs
    assert not {("gist", "poc"), ("fourier_signature", "poc"), ("rotational_pca", "poc_band")} & pairs
    assert "hog" not in {name for name, _ in pairs}
    assert all(float(row["slope_per_m"]) > 0 for row in rows)
    assert all((folder / name).stat().st_size > 0 for name in ("curves.csv", "curves.png", "pareto.png", "run.rrd"))
    assert "r2_best" in result.stdout


def test_cost_says_how_long_it_took(omnilab_at, here):
    arguments = ["study.step_m=0.5", "study.query_count=20"]
    arguments += [f"descriptors.{name}=null" for name in ("radon_45", "radon_gist", "hog_64", "gist", "ring_key")]
    result = omnilab_at(here, "experiment=cost", *SMALL, *arguments)
    assert result.rc == 0, result.stderr
    folder = here / "logs" / "latest"
    rows = {row["method"]: row for row in load_run(folder).table("times")}
    assert len(rows) == 8
    assert all(float(row["describe_ms"]) > 0 and float(row["query_ms"]) > 0 for row in rows.values())
    assert float(rows["rotational_pca"]["fit_s"]) > 0
    assert float(rows["radon"]["bytes"]) == 4 * 48 * 60
    assert (folder / "times.png").is_file()


def test_curves_against_a_setting_of_a_strangers_descriptor(omnilab_in, here):
    result = omnilab_in(
        here, "experiment=parameter_curves", *SMALL[:3], "~descriptors.fourier_signature", "~distances.cosine",
        "+descriptor@descriptors.mine=tiny", "study.parameters.k1=null", "study.parameters.k2=null",
        "+study.parameters.n={of:descriptors.mine.columns,values:[8,32]}", "study.step_m=0.5", "study.query_count=8",
        "study.line_step_m=0.2", "study.reach_m=0.8", "study.references=4", env={"OMNILAB_PLUGINS": str(TINY)},
    )  # fmt: skip
    assert result.rc == 0, result.stderr
    folder = here / "logs" / "latest"
    run = load_run(folder)
    assert [run.metrics[f"bytes_mine_n_{n}"] for n in (8, 32)] == [4 * 8 * 8, 4 * 8 * 32]
    assert [row["value"] for row in run.table("times")] == ["8", "32"]
    assert all((folder / name).stat().st_size > 0 for name in ("curves_n.png", "parameters.png", "run.rrd", "run.mcap"))
