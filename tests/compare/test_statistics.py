"""Metrics over seeds, beside scipy; and what of different runs can be compared."""

from __future__ import annotations

import math
from itertools import count

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy import stats

from omnilab.api import Metric
from omnilab.errors import DataError
from omnilab.runner.compare.comparison import compare_runs

VALUES = st.lists(st.floats(-1e9, 1e9), min_size=2, max_size=7)
number = count()


def of(values):
    return [[Metric("rate", value, "1", (0.0, 1.0), note="nothing")] for value in values]


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(VALUES)
def test_over_seeds_the_interval_is_that_of_a_t_test(made, values):
    sweep = f"sweep{next(number)}"
    folders = [made(f"{sweep}/{i}", seed=i, metrics=metrics) for i, metrics in enumerate(of(values))]
    row = compare_runs([folders[0].parent]).statistics.loc[0, "rate"]
    assert (row["n"], row["interval"]) == (len(values), "Student's t over seeds")
    assert row["mean"] == pytest.approx(np.mean(values), abs=1e-3)
    assert row["std"] == pytest.approx(np.std(values, ddof=1), rel=1e-9, abs=1e-3)
    if np.std(values) > 1e-6 * np.abs(values).max():  # of equal values scipy warns
        interval = stats.ttest_1samp(values, 0).confidence_interval(0.95)
        assert (row["low"], row["high"]) == pytest.approx((interval.low, interval.high), rel=1e-9, abs=1e-6)


def test_one_seed_has_the_interval_of_its_run_and_a_missing_value_counts_in_no_mean(made):
    for i, value in enumerate([0.5, math.nan, 0.7]):
        made(f"sweep/{i}", seed=i, metrics=of([value])[0])
    folder = made("sweep/3", angles=45, metrics=of([0.4])[0]).parent
    found = compare_runs([folder]).statistics
    assert found.loc[(0, "rate"), ["n", "mean"]].tolist() == [2, pytest.approx(0.6)]
    one = found.loc[(1, "rate")]
    assert one[["n", "mean", "low", "high", "interval"]].tolist() == [1, 0.4, 0.0, 1.0, "the run's own"]
    assert math.isnan(one["std"])


def test_the_same_seed_again_is_no_second_sample(made):
    made("sweep/0", seed=0, rate=0.1), made("sweep/1", seed=1, rate=0.4)
    found = compare_runs([made("sweep/2", seed=0, rate=0.2).parent])
    assert found.statistics.loc[(0, "nearest_rate"), ["n", "mean"]].tolist() == [2, pytest.approx(0.3)]
    assert found.notes == ["runs of one configuration and one seed count once, the last of them; left out: 0"]


def test_of_different_studies_the_metrics_of_one_name_are_compared_and_the_rest_is_said(made):
    other = [Metric("nearest_rate", 0.25, "1"), Metric("error_median", 3, "steps"), Metric("views", 7, "1")]
    found = compare_runs([made("a"), made("b", study="steps", metrics=other)])
    assert found.groups.to_dict("list") == {"study": ["grid", "steps"]}
    assert found.metrics == ["nearest_rate"]
    assert found.notes == [
        "these are runs of different studies (grid, steps): only metrics of one name are compared",
        "not compared, for only one configuration has them: views",
        "not compared, for their units differ: error_median (m or steps)",
    ]
    three = compare_runs([made("c"), made("d", angles=1, metrics=other[2:]), made("e", angles=2)])
    assert three.metrics == ["nearest_rate", "error_median"]
    assert three.wide("mean")["nearest_rate"].tolist() == [0.5, pytest.approx(math.nan, nan_ok=True), 0.5]
    assert "missing in some of the configurations: nearest_rate, error_median" in three.notes


def test_runs_without_anything_in_common(made):
    found = compare_runs([made("a"), made("b", study="map", metrics=[Metric("places", 3, "1")])])
    assert (found.metrics, len(found.statistics)) == ([], 0)


def test_what_is_not_finished_or_damaged_is_left_out_and_said(made):
    made("sweep/0"), made("sweep/1", angles=2, status="failed")
    (made("sweep/2", angles=3) / "config.yaml").write_text("seed: [")
    (made("sweep/3", angles=3) / "manifest.json").write_text(
        '{"experiment": "x", "overrides": [], "components": {"a": 1}}'
    )
    (made("sweep/4", angles=3) / "manifest.json").write_text('{"experiment": "x", "overrides": [], "files": 3}')
    (made("sweep/5", angles=3) / "metrics.csv").unlink()
    made("sweep/attempts/1", angles=4)
    folder = made("sweep/10", angles=5).parent
    (folder / "7").mkdir()
    (folder / "7/status.json").write_text("{")
    found = compare_runs([folder, folder / "10"])
    assert found.runs["run"].tolist() == ["0", "5", "10"]
    assert [(run.name, run.state) for run in found.left_out] == [
        ("1", "failed"), ("2", "unreadable"), ("3", "unreadable"), ("4", "unreadable"), ("7", "unreadable"),
    ]  # fmt: skip
    assert "config.yaml cannot be read" in found.left_out[1].why
    with pytest.raises(
        DataError, match=r"none of these runs can be compared: 1 \(failed DataError: no .*images\); give"
    ):
        compare_runs([folder / "1"])
    with pytest.raises(DataError, match="holds no run"):
        compare_runs([folder.parent / "nowhere"])
