"""Reports of studies, spoilt in every way: a sentence that names the study, or no harm."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from spoiling import each_is_a_sentence, parts

from omnilab.api import Metric, Places, Provenance, Report, Signatures
from omnilab.errors import PluginError
from omnilab.geometry import planar_poses
from omnilab.runner.boundaries import check_report

TITLE = "the component"
POSES = planar_poses(np.arange(9.0).reshape(3, 3), np.arange(3.0))
SIGNATURES = Signatures(np.ones((3, 2, 4), np.float32), np.ones((3, 5), np.float32))


class Figure:
    """Of matplotlib."""

    def savefig(self, path: Any) -> None: ...


MAP = Places(SIGNATURES, POSES, ["a", "b", "c"], {"basis": np.eye(2)}, Provenance("mirror", 8, 8, (-10.0, 20.0), False))
REPORT = Report(
    [Metric("error", 1.0, "m", (0.5, 1.5), "a note")],
    {"queries": {"x_m": [1.0, 2.0], "key": np.array(["a", "b"])}},
    {"map": Figure()},
    MAP,
    {"estimate.tum": "0 0 0\n"},
    "## Summary",
    ["one image"],
)


@pytest.mark.parametrize(("path", "part", "put"), [pytest.param(*p, id=p[0] or "report") for p in parts(REPORT)])
def test_a_spoilt_report_is_a_sentence(path: str, part: Any, put: Any) -> None:
    check_report(REPORT, TITLE)
    each_is_a_sentence(f"run{path}", part, lambda new: check_report(put(REPORT, new), TITLE), f"{TITLE}: run returns ")


def report(**changed: Any) -> Report:
    return replace(REPORT, **changed)


def named(name: str) -> list[Metric]:
    return [Metric(name, 1.0, "m")]


@pytest.mark.parametrize(
    ("spoilt_report", "expected"),
    [
        (report(metrics=named("a") + named("a")), "metric 'a' twice"),
        (report(metrics=named(" ")), "without a name"),
        (report(metrics=named("a\x1b[31m")), "characters that nobody sees"),
        (report(metrics=named("a\nb")), "characters that nobody sees"),
        (report(metrics=named("\ud800")), "half a character"),
        (report(metrics=named("\u202eabc")), "characters that nobody sees"),
        (report(metrics=[Metric("a", 10**400, "m")]), "no float holds"),
        (report(metrics=[Metric("a", True, "m")]), "metric 'a' as bool, not as a number"),
        (report(metrics=[Metric("a", 1.0, "m", (1.0,))]), "the interval of metric 'a' as tuple, not as its two ends"),
        (report(tables={"t": {"a": [1, 2], "b": [1]}}), "columns of different lengths"),
        (report(tables={"t": {"a": np.zeros((2, 2))}}), "not as one value a row"),
        (report(tables={"t": {"a": "text"}}), "column 'a' as str, not as a sequence"),
        (report(tables={"t": {1: [1]}}), "a name in table 't' as int, not as a text"),
        *((report(tables={name: {}}), "which is the name of another file") for name in ("metrics", "cost", "METRICS")),
        *((report(files={name: ""}), "which is the name of another file")
          for name in ("status.json", "Manifest.json", "config.yaml", "warnings.txt", "progress.json", "run.log", "run.rrd", "run.lock", "map.npz",
                       "NUL", "con.txt", "lpt1", "latest", "a.part")),
        *((report(files={name: ""}), "which is no name of a file")
          for name in ("../a", "a/b", "a\\b", "/a", "..", ".", "", "a:b", "a.", "a ", ".hidden", "a*", "é" * 101)),
        *((report(tables={name: {}}), "is no name of a file") for name in ("../a", "a/b", "..", "")),
        (report(figures={"a/b": Figure()}), "which is no name of a file"),
        (report(files={"queries.csv": ""}), "'queries.csv' and 'queries.csv', which are one file"),
        (report(files={"Map.PNG": ""}), "'Map.PNG' and 'map.png', which are one file"),
        (report(files={"\u00e9.txt": "", "e\u0301.txt": ""}), "which are one file"),
        (report(map=replace(MAP, keys=["a", "b"])), "`place` of shape (3, 2, 4), not (2, ...)"),
        (report(map=replace(MAP, descriptor_state={"a/b": np.eye(2)})), "the name 'a/b'; use letters, digits and _"),
        (report(map=replace(MAP, descriptor_state={"a": np.array([np.nan])})), "NaN or infinity in `a`"),
    ],
)  # fmt: skip
def test_a_report_that_cannot_be_kept_is_refused(spoilt_report: Report, expected: str) -> None:
    with pytest.raises(PluginError) as refused:
        check_report(spoilt_report, TITLE)
    assert expected in str(refused.value)
