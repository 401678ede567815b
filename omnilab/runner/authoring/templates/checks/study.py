from dataclasses import replace

import numpy as np
from omnilab import Match, Signatures
from omnilab.runner.authoring.templates.components.study import MyStudy
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study, study_parts


def test_it_keeps_the_contract() -> None:
    check_study(MyStudy(spacing_m=1.0))


class Blind:
    """A distance to which all places look alike."""

    def prepare(self, places: Signatures) -> int:
        return len(places)

    def match(self, queries: Signatures, index: int) -> Match:
        return Match(np.ones((len(queries), index), np.float32))


def test_where_all_look_alike_the_first_place_is_the_answer() -> None:
    parts = replace(study_parts(), distance=Blind())
    rng = np.random.default_rng(0)
    report = MyStudy(spacing_m=1.0).run(parts, Recorder(), rng)
    table = {name: np.array(column) for name, column in report.tables["places"].items()}
    assert table["answer"].tolist() == [1] + [0] * (len(table["answer"]) - 1)
    away_m = np.hypot(table["x_m"] - table["x_m"][0], table["y_m"] - table["y_m"][0])
    assert np.allclose(table["distance_m"][1:], away_m[1:])
    metrics = {metric.name: metric.value for metric in report.metrics}
    neighbours = 1 + (away_m[1:] < 1.5).sum()  # the first one's answer is one, too
    assert np.isclose(metrics["neighbour_rate"], neighbours / len(away_m))
