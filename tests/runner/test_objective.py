"""What a run returns to a sweeper, and the metrics that studies declare."""

from __future__ import annotations

import json
import math
import pickle
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from omnilab.errors import ConfigError
from omnilab.runner.hydra_app import SweepRefusedError
from omnilab.runner.registry import discover
from omnilab.runner.run_folder import load_run
from omnilab.runner.sweeps.objective import check_objective, described, is_declared, value_of
from omnilab_studies import Grid

DATA = Path(__file__).parents[1] / "data"
ALONE = ("rms_to_clean", "ate", "chi2", "chi2_before", "wrong_rejected", "true_rejected", "rpe_metre", "drift", "scale",
         "iterations", "problems", "start_gap", "rejected", "trusted", "cost_from_START")  # fmt: skip
OTHERWISE = {  # declared metrics that these runs have not: they need other settings, or came after version 0.1.0
    "localize": {"distance_median"}, "live_localize": {"distance_median"}, "render": {"cloud_points"}, "joint": {"scale"},
    "local_map": {"error_median_all_points_METHOD_LOCALIZER"}, "room": {"error_median_all_points_METHOD_LOCALIZER"},
    "topological_map": {"rms_steps_combined_LENGTHS_LOCALIZER_at_STEP_m", "best_rms_steps_LENGTHS_at_STEP_m"},
    "view_slam": {"FILTER_variables"}, "view_density": {"METHOD_similarity_1m"},
    "pose_graph": {*ALONE, *(f"BACKEND_{name}" for name in (
        "rms_to_clean", "wrong_rejected", "true_rejected", "start_gap", "rejected", "trusted", "cost_from_START"))},
}  # fmt: skip
FOUND = {"nearest_rate": 0.9, "wrong_rate": 0.02, "places": 12.0, "queries": 20.0, "recall_at_1": math.nan}


@pytest.fixture(scope="module")
def measured() -> dict[str, set[str]]:
    """The metrics of the runs that are kept of each study."""
    found: dict[str, set[str]] = {}
    for folder in (path.parent for path in DATA.glob("runs_*/*/metrics.csv")):
        study = json.loads((folder / "manifest.json").read_text())["components"]["study"]["name"]
        found.setdefault(study, set()).update(load_run(folder).metrics)
    return found


STUDIES = {name: component.cls for (kind, name), component in discover("").components.items() if kind == "study"}


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_declares_the_metrics_that_it_has(name, measured):
    declared = STUDIES[name].metric_names
    assert [metric for metric in measured[name] if not is_declared(metric, declared)] == []
    never = {each for each in declared if not any(is_declared(metric, [each]) for metric in measured[name])}
    assert never == OTHERWISE.get(name, set())


def test_a_misspelt_objective_is_a_sentence_with_the_metrics_of_the_study():
    with pytest.raises(ConfigError, match=r"no metric 'nearest_rat'; it has nearest_rate, .*did you mean nearest_rate"):
        check_objective(["wrong_rate", "-nearest_rat"], Grid)
    check_objective("-wrong_rate", Grid)
    check_objective("anything", object())  # does not say which it has
    for wrong in (3, "", [], "-", ["a", 1], "a b"):
        with pytest.raises(ConfigError, match=r"names no metric; give objective=METRIC"):
            check_objective(wrong, Grid)
    with pytest.raises(ConfigError, match="twice"):
        check_objective(["wrong_rate", "-wrong_rate"], Grid)


def test_the_value_is_the_metric_its_negative_or_several():
    assert value_of(None, FOUND) == 0.9
    assert value_of("-wrong_rate", FOUND) == -0.02
    assert value_of(OmegaConf.create(["nearest_rate", "-wrong_rate"]), FOUND) == (0.9, -0.02)
    assert (
        described(["nearest_rate", "-wrong_rate"], (0.9, -0.02)) == "objective: nearest_rate = 0.9, -wrong_rate = -0.02"
    )
    with pytest.raises(ConfigError, match=r"no metric 'nearest'; it has nearest_rate, wrong_rate"):
        value_of("nearest", FOUND)


@pytest.mark.parametrize(
    ("objective", "metrics", "why"),
    [
        ("recall_at_1", FOUND, "recall_at_1 has no value"),
        ("nearest_rate", FOUND | {"places": 1.0}, "with 1 places there is no answer that could be wrong"),
        (None, FOUND | {"queries": 0.0}, "with 0 queries there is no answer that could be wrong"),
        (None, {}, "the run has no value"),
        ("drift", {"drift": math.inf}, "drift has no value"),
    ],
)
def test_what_answers_nothing_sensible_is_no_candidate(objective, metrics, why):
    value = value_of(objective, metrics)
    assert value == why
    with pytest.raises(ValueError, match="could not convert"):  # which is how a sweeper finds a trial that failed
        float(value)


def test_what_ends_a_sweep_comes_back_from_a_worker():
    sent = pickle.loads(pickle.dumps(SweepRefusedError(ConfigError("no metric"))))
    assert isinstance(sent.mistake, ConfigError)
    assert str(sent) == "no metric"
