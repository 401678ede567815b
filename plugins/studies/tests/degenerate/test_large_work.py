"""What studies would hold in memory: refused before it is made, by counts and the first of its kind."""

from __future__ import annotations

import numpy as np
import pytest

from omnilab import limits
from omnilab.api import Signatures
from omnilab.errors import ConfigError
from omnilab_studies.common.describing import check_signatures, check_views
from omnilab_studies.common.image_columns import column_poses
from omnilab_studies.common.methods import check_comparisons
from omnilab_studies.local_maps.candidates import Candidates
from omnilab_studies.view_slam.drives import Drives
from omnilab_studies.view_slam.scenarios import scenario

SIGNATURES = Signatures(np.zeros((10, 100, 50), np.float32), np.zeros((10, 20), np.float32))  # 20 080 bytes each
VIEWS = np.zeros((4, 100, 200, 3), np.uint8)  # 60 000 bytes each


LARGE = {
    "signatures of 60000 places, 2.01e+04 bytes each": lambda: check_signatures(SIGNATURES, 60_000, "places"),
    "20000 images of 200 x 100 pixels": lambda: check_views(VIEWS, 20_000),
    "distances of 100000 images to 3000": lambda: check_comparisons(100_000, 3000),
    "1e+07 poses of 1 columns": lambda: column_poses([[0.0, 0.0]], [0.0, 10.0, 1e-6]),
    "100 drives of 10000 laps with 12 views": lambda: Drives(laps=10_000).drives(scenario("open"), 12, 0, 100),
    "candidates of 200000 queries": lambda: Candidates(None, None, np.zeros((200_000, 49)), 0.0).pairwise_distances(None, 49),  # type: ignore[arg-type]
}  # fmt: skip


@pytest.mark.parametrize("what", LARGE)
def test_what_does_not_fit_into_a_gigabyte_is_refused_before_it_is_made(
    what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "free_memory", lambda: 1e9)
    with pytest.raises(ConfigError) as error:
        LARGE[what]()
    assert what in str(error.value)
    assert "1 GB are free; give" in str(error.value)
    assert str(error.value).endswith("limits=off to try it all the same")


def test_what_fits_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "free_memory", lambda: 1e9)
    check_signatures(SIGNATURES, 49_000, "places")
    check_views(VIEWS, 16_000)
    assert len(column_poses([[0.0, 0.0]], [0.0, 1.0, 0.1])) == 11
    assert len(Drives(laps=1).drives(scenario("open"), 4, 0, 3)) == 3
