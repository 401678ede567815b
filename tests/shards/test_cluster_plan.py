"""What docs/clusters.md says of a cluster on paper, beside a simulation of it event by event."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cluster_simulation import FOURIER, RADON, SIZES, Cluster, moved_bytes, on_paper_s, simulated_s, table, transferred

DOCUMENT = (Path(__file__).parents[2] / "docs" / "clusters.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("study", [RADON, FOURIER], ids=["radon", "fourier"])
def test_the_plan_is_what_happens(study, size):
    cluster = Cluster(*size)
    assert simulated_s(study, cluster) == pytest.approx(on_paper_s(study, cluster), rel=0.01), "without jitter"
    slower = simulated_s(study, replace(cluster, jitter=0.05)) / on_paper_s(study, cluster)
    assert 0.95 <= slower < 1.2


def test_transfers_share_the_disk():
    """Two that begin together, and a third later: by hand, of 100 bytes a second in all and 60 on each link."""
    cluster = Cluster(3, link_bytes_s=60, disk_bytes_s=100)
    ends = transferred(np.array([0.0, 0.0, 1.0]), np.array([100.0, 50.0, 60.0]), cluster)
    # 50 each until 1 s, when the second is done; then 50 each: the first has 50 left, the third 60, and 10 after 2 s at 60
    assert ends == pytest.approx([2.0, 1.0, 2 + 10 / 60])


def test_the_page_has_the_table():
    assert table(RADON) in DOCUMENT
    assert table(FOURIER) in DOCUMENT
    assert moved_bytes(RADON, Cluster(64)) == pytest.approx(100_000 * 124_560 * 66 + 8e6)
