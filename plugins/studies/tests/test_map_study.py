"""The study `map` on sensors that know their images by more than their names."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from omnilab.api import Parts
from omnilab.runner.recorder import Recorder
from omnilab.testing import check_study
from omnilab_studies.localization.map.study import MapStudy

PARTS = {"descriptor": "Painted", "distance": "Apart"}


@pytest.fixture
def parts(plain):
    @dataclass
    class Filed(plain["Floor"]):
        """Frames are known by file and digest, as those of a folder are; the plan knows the files alone."""

        def frames(self, plan):
            for frames in super().frames(plan):
                yield replace(frames, keys=[f"{key}@digest" for key in frames.keys])

    own = {slot: plain[name]() for slot, name in PARTS.items()}
    return lambda **settings: Parts(sensor=Filed(**settings), **own)


class Shown(Recorder):
    """Keeps what is logged, by path."""

    def __init__(self):
        super().__init__()
        self.logged = {}

    def log(self, path, record, tick=None):
        self.logged.setdefault(path, []).append(record)


def test_keeps_the_contract(parts):
    check_study(MapStudy(step_m=1, show=2), parts())


@pytest.mark.parametrize("unread", [[], [3, 11]])
def test_places_are_shown_with_their_own_signatures(parts, unread):
    record = Shown()
    report = MapStudy(step_m=1, show=50).run(parts(unread=unread), record, np.random.default_rng(0))
    assert len(report.map) == 20 - len(unread)
    shown = {tuple(signature.values[0]) for signature in record.logged["query/signature"]}
    assert shown == {tuple(place) for place in report.map.signatures.place}
    assert len(record.logged["query/image"]) == len(report.map)
