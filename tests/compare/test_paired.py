"""Two configurations at the same queries, beside scipy on their queries.csv."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from omnilab.runner.compare.comparison import compare_runs
from omnilab.runner.compare.paired import paired_errors

WORLD = "tests/box_world.yaml"


def queries(seed: int, shift: float = 0.0, count: int = 40, **columns):
    """A table of queries: the poses of a seed, errors that follow them."""
    rng = np.random.default_rng(seed)
    truth, error, noise = rng.normal(size=count), rng.gamma(2, size=count), rng.normal(0, 0.4, count)
    table = {"query": list(range(count)), "key": [f"{i}k" for i in range(count)], "truth_x_m": truth.tolist()}
    table |= {"answer_x_m": (truth + error).tolist(), "error_m": np.abs(error + noise * (shift != 0) + shift).tolist()}
    return table | {"heading_error_deg": [math.nan if i % 7 == 0 else 5.0 for i in range(count)], **columns}


def scipy_of(first, second, column):
    """What scipy gives on two files."""
    a, b = (pd.read_csv(folder / "queries.csv")[column].to_numpy() for folder in (first, second))
    t = stats.ttest_rel(b, a).confidence_interval(0.95)
    boot = stats.bootstrap((b - a,), np.median, n_resamples=9999, method="percentile", rng=np.random.default_rng(0))
    won, lost = (b < a).sum(), (b > a).sum()
    permuted = stats.permutation_test(
        (b, a), lambda x, y, axis: np.mean(x - y, axis=axis), permutation_type="samples", vectorized=True,
        rng=np.random.default_rng(0),
    )  # fmt: skip
    return {
        "mean": (b - a).mean(), "mean_interval": (t.low, t.high), "median": np.median(b - a),
        "median_interval": tuple(boot.confidence_interval), "won": won, "lost": lost, "tied": len(a) - won - lost,
        "sign_p": stats.binomtest(won, won + lost).pvalue, "permutation_p": permuted.pvalue,
    }  # fmt: skip


def test_every_figure_is_scipys_on_the_two_files(made):
    folders = made("a", queries=queries(0)), made("b", angles=45, queries=queries(0, 0.3))
    (found, headings), notes = paired_errors(compare_runs(folders))
    assert notes == []
    assert (found.error, found.unit, found.pairs, found.missing) == ("error_m", "m", 40, 0)
    for name, value in scipy_of(*folders, "error_m").items():
        assert getattr(found, name) == pytest.approx(value, rel=1e-12), name
    assert (headings.error, headings.unit, headings.pairs, headings.missing) == ("heading_error_deg", "deg", 34, 6)
    assert (headings.mean, headings.mean_interval, headings.median_interval) == (0, (0, 0), (0, 0))
    assert (headings.won, headings.tied, headings.lost) == (0, 34, 0)
    assert math.isnan(headings.sign_p)
    assert math.isnan(headings.permutation_p)


def test_runs_of_each_seed_are_paired_and_their_queries_pooled(made, tmp_path):
    for seed in range(3):
        made(f"sweep/{seed}", seed=seed, queries=queries(seed))
        made(f"sweep/{seed + 10}", seed=seed + 1, angles=45, queries=queries(seed + 1, -0.1))
    found = paired_errors(compare_runs([tmp_path / "sweep"]))[0][0]
    assert (found.seeds, found.pairs) == (2, 80)  # seeds 1 and 2


@pytest.mark.parametrize(
    ("first", "second", "sentence"),
    [
        (queries(0), None, "b has no queries.csv with keys and poses"),
        (queries(0), {"rise_m": [1.0], "estimate_m": [2.0]}, "b has no queries.csv with keys and poses"),
        (queries(0), queries(1), "were not asked the same queries"),
        (queries(0), queries(0, key=["x"] * 40), "were not asked the same queries"),
        (queries(0, query=[0] * 40, key=["x"] * 40), queries(0), "names a query twice"),
        (queries(0, error_m=["?"] * 40), queries(0), "holds error_ms that are no numbers"),
        ({k: v for k, v in queries(0).items() if "error" not in k}, queries(0), "have no errors of one kind"),
    ],
)
def test_what_cannot_be_paired_is_said(made, first, second, sentence):
    found, (note,) = paired_errors(compare_runs([made("a", queries=first), made("b", angles=45, queries=second)]))
    assert found == []
    assert sentence in note


def test_seeds_that_differ_and_queries_that_only_one_was_asked(made):
    runs = [made("a", queries=queries(0)), made("b", seed=1, angles=45, queries=queries(0))]
    assert "no seed in common" in paired_errors(compare_runs(runs))[1][0]
    fewer = {name: column[:30] for name, column in queries(0, 0.2).items()}
    infinite = queries(0, error_m=[math.inf, *queries(0)["error_m"][1:]])
    (found, _), _ = paired_errors(compare_runs([made("c", queries=infinite), made("d", angles=45, queries=fewer)]))
    assert (found.pairs, found.missing) == (29, 11)


def test_two_pairs_and_one(made):
    for pairs, name in (2, "two"), (3, "three"):
        table = queries(0, count=pairs), queries(0, 0.5, count=pairs, error_m=[math.nan, *[0.5] * (pairs - 1)])
        runs = [made(f"{name}/a", queries=table[0]), made(f"{name}/b", angles=45, queries=table[1])]
        found = paired_errors(compare_runs(runs))[0][0]
        assert found.pairs == pairs - 1
        assert math.isnan(found.mean_interval[0]) == (pairs == 2)


@pytest.mark.slow  # a sweep in a process of its own
def test_two_descriptors_on_the_same_queries(omnilab_in, tmp_path, request):
    world = request.config.rootpath / WORLD
    small = (f"sensor.world={world}", "sensor.size=48", "sensor.samples=1", "study.step_m=1.5", "study.query_count=25")
    more = (
        "study.show=1",
        "descriptor=tiny_image,fourier_signature",
        "~sinks.rerun",
        "~sinks.mcap",
        "hydra.sweep.dir=sweep",
    )
    assert omnilab_in(tmp_path, "-m", "experiment=grid", *small, *more).rc == 0
    comparison = compare_runs([tmp_path / "sweep"])
    assert comparison.groups["descriptor"].tolist() == ["tiny_image", "fourier_signature"]
    found = {pair.error: pair for pair in paired_errors(comparison)[0]}
    expected = scipy_of(tmp_path / "sweep/0", tmp_path / "sweep/1", "error_m")
    for name, value in expected.items():
        assert getattr(found["error_m"], name) == pytest.approx(value, rel=1e-12), name
    shown = omnilab_in(tmp_path, "compare", "sweep").stdout
    low, high = expected["mean_interval"]
    assert f"({low:.4g} to {high:.4g})" in shown
