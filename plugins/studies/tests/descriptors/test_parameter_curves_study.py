"""Curves against parameters, of parts whose curves, bytes and rates are known."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from omnilab.api import Parts, Series, Signatures, check_settings, setting
from omnilab.errors import ConfigError, DataError
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import ParameterCurves
from omnilab_studies.descriptors.curves import Curve
from omnilab_studies.descriptors.parameter_curves.measures import _resampled_means
from omnilab_studies.descriptors.parameter_curves.parameters import steps_of

SMALL = {"step_m": 0.5, "query_count": 40, "references": 12, "line_step_m": 0.2, "reach_m": 1.0}


@dataclass
class Inner:
    """Settings within settings."""

    copies: int = setting(1, at_least=1, at_most=4)


@dataclass
class Wide:
    """Reads the position back, so many columns wide; a stranger's, which checks nothing by itself."""

    columns: int = setting(2, at_least=2, at_most=8)
    power: float = setting(1.0, above=0)  # of what it reads
    label: str = "a"
    flag: bool = True
    weights: list[float] = setting([1.0])
    inner: Inner = field(default_factory=Inner)
    view, color, rotation, default_distance = "mirror", False, "invariant", "apart"

    def describe(self, images):
        found = np.zeros((len(images), self.columns * self.inner.copies), np.float32)
        found[:, :2] = images[:, 5, 3:5]
        return Signatures(found**self.power)


@dataclass
class Halves:
    """Two settings that must agree, and a description that fails for one value."""

    parts: int = setting(2, at_least=1)
    of: int = setting(4, at_least=1)
    view, color, rotation, default_distance = "mirror", False, "invariant", "apart"

    def __post_init__(self):
        check_settings(self)
        if self.of % self.parts:
            raise ConfigError(f"parts={self.parts} do not divide {self.of}; give a divisor")

    def describe(self, images):
        if self.parts == 4:
            raise DataError("four parts are too many for these images; give two")
        return Signatures(images[:, 5, 3:5].astype(np.float32))


@dataclass
class Closest:
    """The nearest place, or that `off` places further on."""

    off: int = setting(0, at_least=0)

    def prepare(self, places, distance):
        return places, distance, distance.prepare(places.signatures)

    def locate(self, queries, index):
        from omnilab.api import Estimates

        places, distance, own = index
        found = distance.match(queries, own).distance
        best = (found.argmin(axis=1) + self.off) % len(places)
        at = places.T_world_camera[best]
        return Estimates(best, found[np.arange(len(best)), best], at[:, :3, 3], np.zeros(len(best)), found)


@dataclass
class Dimmed:
    """Subtracts grey levels."""

    levels: int = setting(0, at_least=0, at_most=255)

    def apply(self, images, camera, rngs):
        return np.where(images > self.levels, images - self.levels, 0).astype(np.uint8)


@pytest.fixture
def parts(plain):
    return Parts(
        sensor=plain["Floor"](),
        descriptors={"wide": Wide(), "painted": plain["Painted"]()},
        distances={"apart": plain["Apart"](), "bent": plain["Apart"](2.0)},
        localizer=Closest(),
    )


def columns(*values, of="descriptors.wide.columns"):
    return {"k": {"of": of, "values": list(values)}}


def run(parts, parameters, record=None, **settings):
    study = ParameterCurves(parameters=parameters, **{**SMALL, **settings})
    return study.run(parts, record or Recorder(), np.random.default_rng(0))


def metrics_of(report):
    return {m.name: m.value for m in report.metrics}


# ------------------------------------------------------------------------------------------------------------- known
def test_bytes_of_a_descriptor_follow_its_setting(parts):
    report = run(parts, columns(2, 4, 8))
    found = metrics_of(report)
    assert [found[f"bytes_wide_apart_k_{n}"] for n in (2, 4, 8)] == [8, 16, 32]
    assert found["bytes_least"] == 8
    assert found["points"] == 6  # three values, two distances; the other descriptor has no such setting
    assert not [name for name in found if "painted" in name]
    assert found["r2_wide_apart_k_2"] == pytest.approx(1)
    assert found["nearest_wide_apart_k_2"] > 0.9


def test_a_power_bends_the_curve_as_it_must(parts):
    found = metrics_of(run(parts, columns(1.0, 2.0, of="distances.bent.power"), query_count=0))
    x = np.arange(1, 6) / 5
    bent = Curve(x, x**2, x)
    assert found["r2_wide_bent_k_2"] == pytest.approx(bent.r2_centred, abs=1e-6)
    assert found["r2_painted_bent_k_1"] == pytest.approx(1)
    assert found["slope_per_m_painted_bent_k_1"] == pytest.approx(60)
    assert found["points"] == 4  # both descriptors, this distance alone
    assert not [name for name in found if "nearest" in name]


def test_rates_follow_localizer_and_disturbance(parts):
    parts = replace(parts, disturbances={"dimmed": Dimmed()})
    found = metrics_of(run(parts, {"off": {"of": ["localizer.off"], "values": [0, 1]}}, references=0))
    assert found["nearest_painted_apart_off_0"] > 0.9
    assert found["nearest_painted_apart_off_1"] < 0.1
    assert found["points"] == 8
    spoilt = metrics_of(run(parts, {"d": {"of": ["disturbances.dimmed.levels"], "values": [0, 60, 120]}}, references=0))
    errors = [spoilt[f"position_error_painted_apart_d_{n}"] for n in (0, 60, 120)]
    assert errors[0] < errors[1] - 0.3 < errors[2] - 0.6  # 60 levels are a metre


def test_another_sensor_images_anew(parts):
    @dataclass
    class Brighter(type(parts.sensor)):
        gain: float = setting(1.0, above=0)

        def frames(self, plan):
            for frames in super().frames(plan):
                yield replace(frames, images=(self.gain * frames.images).astype(np.uint8))

    found = metrics_of(run(replace(parts, sensor=Brighter()), columns(0.5, 1.0, of="sensor.gain"), query_count=0))
    assert found["slope_per_m_painted_apart_k_0.5"] == pytest.approx(30, rel=0.02)
    assert found["slope_per_m_painted_apart_k_1"] == pytest.approx(60)


def test_one_parameter_may_be_settings_of_several_components(parts, plain):
    parts = replace(parts, descriptors={"a": Wide(), "b": Wide(inner=Inner(3))}, distances={"apart": plain["Apart"]()})
    both = {"k": {"of": ["descriptors.a.columns", "descriptors.b.columns"], "values": [2, 4]}}
    found = metrics_of(run(parts, both, query_count=0))
    assert [found[f"bytes_{name}_k_{n}"] for name in "ab" for n in (2, 4)] == [8, 16, 24, 48]


def test_settings_within_settings(parts):
    found = metrics_of(run(parts, columns(1, 3, of="descriptors.wide.inner.copies"), query_count=0))
    assert (found["bytes_wide_apart_k_1"], found["bytes_wide_apart_k_3"]) == (8, 24)


def test_a_trainable_descriptor_is_trained_and_its_time_taken(parts, plain):
    parts = replace(parts, descriptors={"taught": plain["Taught"]()})
    report = run(parts, columns(1.0, 3.0, of="descriptors.taught.scale"))
    assert metrics_of(report)["slope_per_m_taught_apart_k_3"] == pytest.approx(180)
    assert all(value > 0 for value in report.tables["times"]["fit_ms"])


# ----------------------------------------------------------------------------------------------- intervals and times
def test_intervals_hold_the_value_and_times_are_no_metrics(parts):
    parts.sensor.blocked = [[2.0, 1.0]]
    report = run(parts, columns(1.0, 2.0, of="descriptors.wide.power"))
    for metric in report.metrics:
        if metric.interval is not None:
            assert metric.interval[0] - 1e-9 <= metric.value <= metric.interval[1] + 1e-9
        assert "_ms" not in metric.name
    times = report.tables["times"]
    assert all(value > 0 for name in ("view_ms", "describe_ms", "locate_ms") for value in times[name])
    assert all(low <= at <= high for low, at, high in zip(
        times["describe_ms_low"], times["describe_ms"], times["describe_ms_high"], strict=True))  # fmt: skip
    assert set(report.tables) == {"parameters", "times", "curves"}
    assert len(report.tables["curves"]["mean"]) == 4 * 5
    assert set(report.figures) == {"parameters", "curves_k"}


def test_lines_of_one_place_are_drawn_together():
    values, row = np.array([[0.0], [2.0], [10.0]]), np.array([0, 0, 1])
    means = _resampled_means(values, row, np.random.default_rng(0))
    assert set(np.round(means[:, 0], 9)) == {1.0, 4.0, 10.0}  # the first place twice, each once, the second twice


def test_every_image_is_described_as_often_as_asked(parts):
    counts = []
    described = Wide.describe

    @dataclass
    class Counting(Wide):
        def describe(self, images):
            counts.append(len(images))
            return described(self, images)

    run(replace(parts, descriptors={"wide": Counting()}), columns(2, 4), query_count=0, references=0, repeats=3)
    assert sum(counts) == 2 * (2 + 3 * 9 * 7)  # a warm-up of two, then three times all


# ------------------------------------------------------------------------------------------------------------ records
def test_curves_are_shown(parts):
    record = Kept()
    run(parts, columns(2, 4), record)
    shown = {path: r for path, r in record.records if isinstance(r, Series)}
    assert list(shown["against/bytes/k_wide"].steps) == [2, 4]
    assert list(shown["against/bytes/k_wide"].values) == [8, 16]
    assert "against/nearest/k_wide_bent" in shown
    assert list(shown["curves/k/2_wide_apart"].steps) == [20, 40, 60, 80, 100]


def test_steps_of_the_logs():
    assert steps_of([1.0, 4.0]) == [1, 4]
    assert steps_of([0.5, 1.0, 4.0]) == [0, 1, 2]


def test_it_keeps_the_contract(parts):
    check_study(ParameterCurves(parameters=columns(2, 4), **SMALL), parts)
    assert ParameterCurves.cached is False


# ---------------------------------------------------------------------------------------------------------- bad input
@pytest.mark.parametrize(
    ("of", "values", "words"),
    [
        ("descriptors.wide.colums", [2], r"'colums', which is no setting of descriptors.wide; .* \(did you mean columns\?\)"),
        ("descriptors.wid.columns", [2], r"there is no descriptors.wid; there is wide, painted \(did you mean wide\?\)"),
        ("descriptor.columns", [2], r"the run has no descriptor; there is .*\(did you mean descriptors\?\)"),
        ("descriptors.wide", [2], "give one of it, such as descriptors.wide.SETTING"),
        ("descriptors.wide.label", [2], "label, which holds no number; of descriptors.wide, these do: columns, power"),
        ("descriptors.wide.flag", [1], "flag, which holds no number"),
        ("descriptors.wide.weights", [1], "weights, which holds no number"),
        ("descriptors.wide.columns.more", [2], "'more', which is no setting of descriptors.wide.columns"),
        ("descriptors.wide.columns", [2, 99], "columns=99 is out of range; give a whole number from 2 to 8"),
        ("descriptors.wide.columns", [2.5], "columns=2.5 is not whole"),
        ("altimeters.x.offsets", [2], "sweep it over its own study: omnilab -m ... altimeters.x.offsets=A,B"),
        ("nonsense", [2], "the run has no nonsense"),
    ],
)  # fmt: skip
def test_settings_and_values_that_there_are_not(parts, of, values, words):
    with pytest.raises(ConfigError, match=words):
        run(parts, columns(*values, of=of))
    assert parts.sensor.asked == []  # before anything is imaged


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"parameters": {}}, "study.parameters is empty"),
        ({"parameters": {"k": {"of": ["descriptors.wide.columns"], "values": []}}}, r"values=\[\] are no numbers"),
        ({"parameters": {"k": {"of": [], "values": [1]}}}, r"of=\[\] names no settings"),
        ({"parameters": {"k": {"of": 3, "values": [1]}}}, "of=3 names no settings"),
        ({"parameters": {"k": {"of": "a.b", "values": [1, "two"]}}}, "are no numbers; give some"),
        ({"parameters": {"k": {"of": "a.b", "values": [1, float("nan")]}}}, "holds nan, which is not a number"),
        ({"parameters": {"k": {"of": "a.b"}}}, "is no parameter; give such as"),
        ({"parameters": {"k": [1, 2]}}, "is no parameter; give such as"),
        ({"parameters": {"a/b": {"of": ["descriptors.wide.columns"], "values": [2]}}}, "'a/b'; give a name of letters"),
        ({"parameters": columns(2, 2)}, "has 2 more than once"),
        ({"line_step_m": 0.9}, "at least 3 steps"),
        ({"every": 2}, "give one of them"),
        ({"query_count": 0, "parameters": {"k": {"of": ["localizer.off"], "values": [1]}}}, "rates alone depend on"),
    ],
)
def test_bad_parameter_curves_settings(parts, settings, words):
    with pytest.raises(ConfigError, match=words):
        run(parts, **{"parameters": columns(2), **settings})


def test_settings_that_must_agree_are_refused_at_once(parts):
    parts = replace(parts, descriptors={"halves": Halves()})
    with pytest.raises(ConfigError, match=r"study.parameters.k at 3: parts=3 do not divide 4"):
        run(parts, columns(2, 3, of="descriptors.halves.parts"))


def test_a_value_that_fails_is_left_out_with_its_reason(parts):
    parts = replace(parts, descriptors={"halves": Halves()})
    report = run(parts, columns(2, 4, of="descriptors.halves.parts"))
    assert (metrics_of(report)["points"], metrics_of(report)["misfits"]) == (2, 2)
    assert any("halves + apart with k=4: four parts are too many" in sentence for sentence in report.omitted)
    with pytest.raises(DataError, match=r"none of the values can be measured .*four parts are too many"):
        run(parts, columns(4, of="descriptors.halves.parts"))


def test_rates_take_a_localizer(parts):
    with pytest.raises(ConfigError, match=r"give localizer=nearest, or study.query_count=0"):
        run(replace(parts, localizer=None), columns(2))


class Kept(Recorder):
    """Keeps what is logged."""

    def __init__(self):
        super().__init__()
        self.records = []

    def log(self, path, record, tick=None):
        self.records.append((path, record))
