"""Maps that adapt: policies on signatures of one number, whose estimates and ratios are known, and the study on a plain floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnilab.api import Answers, Circle, Frames, Image, Match, Parts, Places, Series, Signatures
from omnilab.cameras import ImageCircle
from omnilab.errors import ConfigError
from omnilab.geometry import planar_poses
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies import LifelongMap
from omnilab_studies.localization.lifelong_map.appearances import FIRST, AppearanceIndex, of_first_day
from omnilab_studies.localization.lifelong_map.policies import policy_of
from omnilab_studies.localization.lifelong_map.policies.several import Several
from omnilab_studies.localization.lifelong_map.policies.update import Update
from omnilab_studies.localization.lifelong_map.policy_run import PolicyRun

CAMERA = ImageCircle(16, 16, Circle(7.5, 7.5, 8))


@dataclass
class Difference:
    """|query - place| of signatures of one number, less `under`; a rotation of 0.5 everywhere."""

    under: float = 0.0

    def prepare(self, places):
        return places.place

    def match(self, queries, index):
        distance = np.abs(queries.place - index.T) - self.under
        return Match(distance, np.full_like(distance, 0.5))


def poses_of(x):
    return planar_poses(np.column_stack([x, np.zeros((len(x), 2))]))


def line(count):
    """Places 1 m apart that look like 0, 10, 20, ..."""
    T = poses_of(np.arange(float(count)))
    return Places(Signatures(10 * np.arange(count, dtype=float)[:, None]), T, [str(i) for i in range(count)])


def located(known, places, values, first=0, distance=None):
    index = AppearanceIndex(known, places.T_world_camera[:, :3, 3], distance or Difference(), 0.5)
    return index.locate(Signatures(np.array(values, float)[:, None]), first + np.arange(len(values)))


def test_the_ratio_is_to_the_best_place_elsewhere():
    places = line(3)
    known = of_first_day(places, places.T_world_camera)
    estimates, scorable = located(known, places, [1, 4, 14, 20])
    assert estimates.place.tolist() == [0, 0, 1, 2]
    np.testing.assert_allclose(estimates.ratio, [1 / 9, 4 / 6, 4 / 6, 0])
    np.testing.assert_allclose(estimates.heading_rad, 0.5)
    np.testing.assert_allclose(scorable.field[1], [4, 6, 16])
    lonely, _ = AppearanceIndex(known, places.T_world_camera[:, :3, 3], Difference(), 9.0).locate(
        Signatures(np.ones((1, 1))), np.zeros(1, int)
    )
    assert lonely.ratio.tolist() == [1]  # nothing is elsewhere, so nothing is sure
    with pytest.raises(ConfigError, match=r"the distance gives -2, and lifelong_map compares ratios .*choose another"):
        located(known, places, [10], distance=Difference(2.0))


def test_fixed_keeps_the_map():
    places = line(3)
    known = of_first_day(places, places.T_world_camera)
    assert policy_of("fixed", {}).adapt(known, located(known, places, [1, 19])[0], 0) is known


def test_update_takes_the_surest_query_of_each_place_that_is_sure():
    places = line(3)
    known = of_first_day(places, places.T_world_camera)
    adapted = Update(sure_ratio=0.3).adapt(known, located(known, places, [2, 1, 14, 19], first=7)[0], 3)
    assert adapted.place.tolist() == [1, 0, 2]  # oldest first
    assert adapted.signatures.place.ravel().tolist() == [10, 1, 19]
    assert adapted.origin.tolist() == [FIRST, 8, 10]
    assert adapted.matched_day.tolist() == [0, 3, 3]
    np.testing.assert_allclose(adapted.heading_rad, [0, 0.5, 0.5])


def test_several_adds_what_looks_new_and_forgets_the_least_recently_matched():
    places = line(3)
    known = of_first_day(places, places.T_world_camera)
    policy = Several(sure_ratio=0.5, familiar_ratio=0.2, appearances=2)
    known = policy.adapt(known, located(known, places, [1, 12, 16])[0], 1)
    # 1 is familiar (1/9), 12 is new (2/8), 16 is not sure (4/6)
    assert known.place.tolist() == [0, 1, 2, 1]
    assert known.signatures.place.ravel().tolist() == [0, 10, 20, 12]
    assert known.matched_day.tolist() == [1, 1, 0, 1]
    known = policy.adapt(known, located(known, places, [10, 12], first=3)[0], 2)  # both familiar
    assert known.matched_day.tolist() == [1, 2, 0, 2]
    known = policy.adapt(known, located(known, places, [10], first=5)[0], 3)
    known = policy.adapt(known, located(known, places, [7], first=6)[0], 4)  # 3/7: new; 12 was matched before 10 was
    assert known.place.tolist() == [0, 2, 1, 1] or known.place.tolist() == [0, 1, 2, 1]
    assert sorted(known.signatures.place[known.place == 1].ravel()) == [7, 10]


@given(st.integers(1, 4), st.lists(st.lists(st.floats(-5, 45), min_size=1, max_size=12), min_size=1, max_size=5))
@settings(max_examples=40, deadline=None)
def test_no_place_is_lost_and_none_has_more_appearances_than_it_may(most, days):
    places = line(5)
    for policy in (Several(0.9, 0.1, most), Update(1.0)):
        known, queries = of_first_day(places, places.T_world_camera), 0
        for day, values in enumerate(days):
            estimates, _ = located(known, places, values, queries)
            known, queries = policy.adapt(known, estimates, day), queries + len(values)
            held = np.bincount(known.place, minlength=5)
            assert held.min() >= 1
            assert held.max() <= (most if isinstance(policy, Several) else 1)
            taken = known.origin >= 0
            values_of = np.concatenate(days)[known.origin[taken]]
            np.testing.assert_array_equal(known.signatures.place[taken, 0], values_of)


def live(policy, drifts, count=6):
    """A policy over days on each of which every place is seen as it was plus a number."""
    places = line(count)
    run = PolicyRun("any", policy, places, Difference(), 0.5)
    for day, drift in enumerate(drifts):
        keys, index = [str(i) for i in range(count)], np.arange(count)
        frames = Frames(np.zeros((count, 16, 16), np.uint8), keys, index, CAMERA, index, places.T_world_camera)
        run.begin_day()
        run.localize(frames, Signatures(places.signatures.place + drift))
        run.end_day(day)
    return run


def rates(run):
    return [float((day.scored.verdict == "nearest").mean()) for day in run.days]


def test_an_updated_map_follows_a_drift_that_a_fixed_one_does_not():
    drifts = [0, 3, 6, 9, 12]
    assert rates(live(policy_of("fixed", {}), drifts)) == [
        1,
        1,
        1 / 6,
        1 / 6,
        1 / 6,
    ]  # the last place has none above it
    assert rates(live(Update(), drifts)) == [1] * 5
    assert rates(live(Several(familiar_ratio=0.0, appearances=2), drifts)) == [1] * 5


def test_wrong_updates_are_counted_and_stay_in_the_map():
    """After a jump of 6 all places but the last are taken for the next, with a ratio of 4/6, and learnt so."""
    (day,) = live(Update(0.8), [6]).days
    assert (day.updates, day.wrong_updates) == (5, 4)
    assert (day.signatures, day.wrong_signatures) == (6, 4)
    (careful,) = live(Update(0.5), [6]).days
    assert (careful.updates, careful.wrong_updates) == (1, 0)
    several = live(Several(appearances=3), [6, 0]).days[-1]
    assert (several.signatures, several.wrong_signatures) == (6 + 4, 4)


@dataclass
class Shade:
    """Adds to all levels."""

    level: int = 0

    def apply(self, images, camera, rngs):
        return images + np.uint8(self.level)


@pytest.fixture
def parts(plain):
    return Parts(
        sensor=plain["Floor"](),
        descriptor=plain["Painted"](),
        distance=plain["Apart"](),
        disturbances={"shade": Shade()},
    )


SMALL = {
    "step_m": 1.0,
    "query_count": 20,
    "conditions": {"east": {"shade": {"level": 12}}},
    "days": ["unchanged", "east"],
}


def logged(study, parts):
    record, found = Recorder(), []
    record.log = lambda path, value, tick=None: found.append((path, value))
    return study.run(parts, record, np.random.default_rng(7)), found


def test_the_study_keeps_its_contract_and_days_have_their_conditions(parts):
    check_study(LifelongMap(**SMALL), parts)
    report, found = logged(LifelongMap(**SMALL), parts)
    metrics = {metric.name: metric for metric in report.metrics}
    assert metrics["places"].value == 5 * 4
    assert np.isnan(metrics["fixed_wrong_update_share"].value)
    assert metrics["fixed_signatures"].value == metrics["update_signatures"].value == 20
    days = [value for path, value in found if path == "answers/fixed"]
    assert [type(day) for day in days] == [Answers, Answers]
    for day, shift_m in zip(days, (0, 12 / 60), strict=True):  # 60 levels a metre: the floor seems to have moved
        seen = np.clip(np.round(day.truth_m[:, :2] + shift_m), 0, [4, 3])
        np.testing.assert_allclose(day.answer_m[:, :2], seen)
    assert report.tables["days"]["nearest_rate"][:2] == [
        np.mean([verdict == "nearest" for verdict in day.verdict]) for day in days
    ]
    series = {path: value for path, value in found if isinstance(value, Series)}
    assert set(series) == {f"{kind}/{name}" for kind in ("nearest", "signatures", "wrong_signatures") for name in
                           ("fixed", "update", "several")}  # fmt: skip
    assert sum(path == "query/image" and isinstance(value, Image) for path, value in found) == 2


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"days": []}, r"study\.days is empty"),
        (
            {"days": ["easts"]},
            r"study\.days names 'easts', which is no condition; there is unchanged, east .did you mean east.*",
        ),
        ({"policies": {}}, r"study\.policies is empty"),
        (
            {"policies": {"often": {}}},
            r"study\.policies\.often: there is no policy 'often'; give policy: fixed, update",
        ),
        ({"policies": {"update": {"sure": 1}}}, r"study\.policies\.update\.sure is no setting .* sure_ratio"),
        ({"policies": {"update": {"sure_ratio": 2.0}}}, r"study\.policies\.update\.sure_ratio=2"),
        (
            {"policies": {"update": {"sure_ratio": "much"}}},
            r"study\.policies\.update\.sure_ratio=much is no number; give one, such as 0\.8",
        ),
        ({"policies": {"several": {"appearances": 2.5}}}, r"several\.appearances=2\.5 is no whole number"),
        ({"conditions": {"unchanged": {}}}, r"study\.conditions\.unchanged is the world as it is"),
        ({"conditions": {"east": {"light": {"gain": 1}}}}, r"east\.light is no disturbance of the run; it has shade"),
        (
            {"conditions": {"east": {"shade": {"gain": 1}}}},
            r"east\.shade changes 'gain', which is no setting of the shade",
        ),
        ({"conditions": {"east": {"gain": 1}}}, r"east changes 'gain', which is no setting of the sensor"),
    ],
)
def test_bad_settings_are_a_sentence(parts, change, sentence):
    with pytest.raises(ConfigError, match=sentence):
        LifelongMap(**{**SMALL, **change}).run(parts, Recorder(), np.random.default_rng(0))
