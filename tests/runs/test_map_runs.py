"""A map made by one run, localised in by others."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from omnilab.runner.map_file import load_places
from omnilab.runner.run_folder import load_run

pytestmark = pytest.mark.slow  # whole runs

WORLD = Path(__file__).parents[1] / "box_world.yaml"
SENSOR = [f"sensor.world={WORLD}", "sensor.size=96", "sensor.samples=1"]
MAP = ["experiment=map", "study.step_m=0.5", "study.show=2", *SENSOR]
RADON = ["descriptor.offsets=48", "descriptor.angles=60"]
ASK = ["experiment=localize", "study.query_count=20", "study.show=2", *SENSOR]


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    return tmp_path_factory.mktemp("maps")


@pytest.fixture(scope="module")
def made(omnilab_at, here):
    """A map by Radon, and one by a descriptor that learns."""
    folders = {}
    for name, settings in {
        "radon": RADON,
        "pca": ["descriptor=rotational_pca", "descriptor.components=8"],
    }.items():
        result = omnilab_at(here, *MAP, *settings)
        assert result.rc == 0, result.stderr
        folders[name] = (here / "logs" / "latest").resolve()
    return folders


def test_a_map_run_keeps_its_map(made):
    places = load_places(made["radon"] / "map.npz")
    metrics = load_run(made["radon"]).metrics
    assert len(places) == metrics["places"] > 30
    assert metrics["step"] == pytest.approx(0.5)
    assert metrics["bytes_per_place"] == 4 * 48 * 60
    assert places.signatures.place.shape == (len(places), 48, 60)


@pytest.mark.parametrize("which", ["radon", "pca"])
def test_the_map_brings_its_descriptor_and_what_it_learnt(omnilab_at, here, made, which):
    result = omnilab_at(here, *ASK, f"map={made[which]}")
    assert result.rc == 0, result.stderr
    folder = here / "logs" / "latest"
    metrics = load_run(folder).metrics
    assert metrics["nearest_rate"] + metrics["second_rate"] > 0.6
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["components"]["descriptor"]["name"] == {"radon": "radon", "pca": "rotational_pca"}[which]
    assert manifest["files"]["map"]


def test_it_answers_as_the_grid_study_does(omnilab_at, here, made):
    """The same places and the same queries, described in one run or in two."""
    folder = here / "logs" / "latest"
    grid = ["experiment=quickstart", "study.step_m=0.5", "study.query_count=20", "study.show=2", *SENSOR, *RADON]
    assert omnilab_at(here, *grid).rc == 0
    expected = load_run(folder).metrics
    assert omnilab_at(here, *ASK, f"map={made['radon']}").rc == 0
    found = load_run(folder).metrics
    shared = {"nearest_rate", "position_error_mean", "heading_error_mean", "recall_at_5", "average_precision"}
    assert {name: found[name] for name in shared} == {name: expected[name] for name in shared}


def test_repeat_localises_in_the_same_map(omnilab_at, here, made):
    assert omnilab_at(here, *ASK, f"map={made['radon']}").rc == 0
    folder = (here / "logs" / "latest").resolve()
    result = omnilab_at(here, "repeat", str(folder))
    assert result.rc == 0, result.stderr
    assert (here / "logs" / "latest").resolve() != folder
    assert load_run(here / "logs" / "latest").metrics == load_run(folder).metrics


def test_another_distance_may_be_chosen_and_another_descriptor_not(omnilab_at, here, made):
    assert omnilab_at(here, *ASK, f"map={made['radon']}", "distance=poc").rc == 0
    for other in (["descriptor=gist"], ["descriptor=radon"]):  # the second with other sizes
        result = omnilab_at(here, *ASK, f"map={made['radon']}", *other)
        assert result.rc == 2
        assert "was described by radon (offsets=48, angles=60, color=False)" in result.stderr


def test_without_a_map_it_says_how_to_make_one(omnilab_at, here):
    result = omnilab_at(here, *ASK)
    assert result.rc == 2
    assert "needs a map" in result.stderr
    assert "experiment=map" in result.stderr


def test_a_map_by_a_component_that_is_not_installed(omnilab_at, here, made, tmp_path):
    with np.load(made["radon"] / "map.npz") as archive:
        arrays = dict(archive)
    about = json.loads(arrays["about"].item())
    about["components"]["descriptor"] |= {"name": "theirs", "distribution": "theirs-9"}
    np.savez(tmp_path / "theirs.npz", **arrays | {"about": np.array(json.dumps(about))})
    result = omnilab_at(here, *ASK, f"map={tmp_path / 'theirs.npz'}")
    assert result.rc == 2
    assert "descriptor 'theirs' does not exist" in result.stderr
    assert "theirs-9" in result.stderr


def test_recorded_queries_without_positions_are_answered(omnilab_at, here, made, tmp_path):
    data = tmp_path / "set"
    render = ["experiment=render", "study.layout=random", "study.count=6", f"study.folder={data}"]
    assert omnilab_at(here, *render, *SENSOR).rc == 0
    ask = [
        "experiment=localize",
        "sensor=folder",
        f"sensor.path={data}",
        "study.queries=recorded",
        f"map={made['radon']}",
    ]
    assert omnilab_at(here, *ask).rc == 0
    truth = {row["key"]: row for row in load_run(here / "logs/latest").table("queries")}
    (data / "positions.csv").rename(tmp_path / "kept.csv")
    result = omnilab_at(here, *ask)
    assert result.rc == 0, result.stderr
    answers = load_run(here / "logs/latest").table("answers")
    assert len(answers) == len(truth) == 6
    assert load_run(here / "logs/latest").metrics["queries"] == 6
    for row in answers:  # the same answers, only that nobody knows whether they are right
        known = next(known for known in truth.values() if known["query"] == row["query"])
        assert {name: row[name] for name in ("place", "answer_x_m", "distance")} == {
            name: known[name] for name in ("place", "answer_x_m", "distance")
        }
