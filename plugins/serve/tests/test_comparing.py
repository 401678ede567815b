"""Charts, marks and words of comparisons, from documents of `omnilab compare --json`."""

from __future__ import annotations

import re

import pytest

from omnilab_serve.comparing.charts import (
    BOTTOM,
    HEIGHT,
    LEFT,
    RIGHT,
    TOP,
    WIDTH,
    ChartAxis,
    color_of,
    error_charts,
    metric_charts,
    recall_chart,
    round_values,
)
from omnilab_serve.comparing.words import best_of, meaning_of, ordered


def statistics(mean, low=None, high=None):
    return {"n": 1, "mean": mean, "std": None, "low": low, "high": high, "interval": "", "text": str(mean)}


def document(settings, rows, unit=""):
    """A row: values of the settings, and mean, low and high of the one metric."""
    return {
        "settings": settings,
        "metrics": [{"name": "error_m", "unit": unit}, {"name": "recall_at_1", "unit": ""}],
        "configurations": [
            {
                "name": chr(ord("A") + i),
                "settings": dict(zip(settings, values, strict=True)),
                "seeds": 1,
                "metrics": {"error_m": statistics(*numbers), "recall_at_1": statistics(1 - numbers[0])},
            }
            for i, (values, numbers) in enumerate(rows)
        ],
    }


def numbers(path):
    return [tuple(map(float, point.split(","))) for point in re.findall(r"[-\d.]+,[-\d.]+", path)]


def test_an_axis_is_linear_between_its_ends_or_in_powers_of_ten():
    axis = ChartAxis(0.0, 10.0, 100.0, 200.0)
    assert [axis.at(value) for value in (0, 5, 10)] == [100, 150, 200]
    logarithmic = ChartAxis(1.0, 100.0, 0.0, 100.0, logarithmic=True)
    assert [logarithmic.at(value) for value in (1, 10, 100)] == [0, 50, 100]
    assert [tick.words for tick in logarithmic.ticks()] == ["1", "10", "100"]
    assert round_values(0.0, 1.0) == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    assert ChartAxis(3.0, 3.0, 0.0, 10.0).at(3.0) == 5.0


def test_a_curve_of_errors_rises_to_the_share_of_queries_that_have_one():
    curve = {"configuration": "B", "error": "error_m", "unit": "m", "queries": 10, "missing": 5}
    curve["quantiles"] = [float(share) for share in range(101)]
    (chart,) = error_charts({"error_curves": {"shares": list(range(101)), "curves": [curve]}})
    (drawn,) = chart.curves
    points = numbers(drawn.line)
    assert (drawn.label, drawn.color) == ("B", 1)
    top, bottom = TOP + 4, HEIGHT - BOTTOM - 4
    assert points[0] == (LEFT + 8, bottom)
    assert points[-1] == pytest.approx((WIDTH - RIGHT - 8, (top + bottom) / 2), abs=0.1)
    assert chart.up == "queries within [%]"


def test_outliers_do_not_press_a_curve_together():
    curve = {"configuration": "A", "error": "error_m", "unit": "m", "queries": 100, "missing": 0}
    curve["quantiles"] = [share / 95 for share in range(100)] + [1000.0]
    (chart,) = error_charts({"error_curves": {"shares": list(range(101)), "curves": [curve]}})
    assert float(chart.ticks_across[-1].words) <= 1.6
    assert max(x for x, _ in numbers(chart.curves[0].line)) == WIDTH - RIGHT - 8


def test_a_metric_over_a_number_has_a_curve_for_each_value_of_the_other():
    rows = [((a, d), (e, e - 1, e + 1)) for d, e in (("hog", 5.0), ("radon", 3.0)) for a in ("10", "2", "6")]
    charts = metric_charts(document(["angles", "descriptor"], rows, "m"), "error_m")
    over_angles, over_descriptor = charts
    assert [curve.label for curve in over_angles.curves] == ["descriptor=hog", "descriptor=radon"]
    assert [tick.words for tick in over_angles.ticks_across] == ["2", "6", "10"]
    marks = over_angles.curves[0].marks
    assert [mark.x for mark in marks] == pytest.approx([LEFT + 8, (LEFT + WIDTH - RIGHT) / 2, WIDTH - RIGHT - 8])
    assert all(mark.low > mark.y > mark.high for mark in marks), "pixels go down"
    assert over_angles.curves[0].band
    assert over_angles.up == "error_m [m]"
    assert all(curve.line == "" for curve in over_descriptor.curves), "there is nothing between two names"


def test_settings_that_change_together_are_one_axis():
    rows = [(("hog", "l2"), (1.0,)), (("radon", "poc"), (2.0,))]
    (chart,) = metric_charts(document(["descriptor", "distance"], rows), "error_m")
    assert chart.across == "descriptor"
    assert metric_charts(document([], [((), (1.0,))]), "error_m") == []


def test_recall_needs_two_counts_of_places():
    found = document(["a"], [(("1",), (0.4,)), (("2",), (0.1,))])
    assert recall_chart(found) is None
    found["metrics"].append({"name": "recall_at_10", "unit": ""})
    for row in found["configurations"]:
        row["metrics"]["recall_at_10"] = statistics(1.0)
    chart = recall_chart(found)
    assert [tick.words for tick in chart.ticks_across] == ["1", "10"]
    assert [curve.label for curve in chart.curves] == ["A", "B"]
    assert "A: 0.6 at 1; B: 0.9 at 1" in chart.summary


def test_the_best_is_marked_where_it_is_known():
    found = document(["a"], [(("1",), (0.4,)), (("2",), (0.1,)), (("3",), (None,))][:2])
    assert best_of(found, "") == {"error_m": ["B"]}
    assert best_of(found, "-recall_at_1") == {"error_m": ["B"], "recall_at_1": ["B"]}
    assert best_of(found, "recall_at_1")["recall_at_1"] == ["A"]
    assert best_of(found, "-error_m")["error_m"] == ["A"]
    found["configurations"][0]["metrics"]["error_m"]["mean"] = None
    assert [row["name"] for row in ordered(found, "error_m")] == ["B", "A"]
    assert best_of(found, "") == {}, "one value is no best"


@pytest.mark.parametrize(
    ("mean", "p", "sentence"),
    [
        (-0.5, 0.03, r"B has smaller errors than A, by 0\.5 m on average; chance alone .* about 3 times in 100\."),
        (0.5, 0.0004, r"B has larger errors than A.* once in 1000 times or less\."),
        (0.5, 0.4, r"but chance alone may well do that: about 40 times in 100\."),
        (0.0, None, r"The errors are the same at every query\."),
    ],
)
def test_words_of_a_paired_difference(mean, p, sentence):
    pair = {"first": "A", "second": "B", "unit": "m", "mean": mean, "permutation_p": p, "pairs": 9, "tied": 9}
    assert re.search(sentence, meaning_of(pair))


def test_colours_begin_anew_after_the_last():
    assert [color_of(letter) for letter in ("A", "B", "H", "I", "Z", "AA")] == [0, 1, 7, 0, 1, 2]
