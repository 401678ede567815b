"""The layout and the figure of a study of someone else: as those of ours, without a hook of their own."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

STUDY = '''
from dataclasses import dataclass
from typing import ClassVar
import numpy as np
from omnilab import Metric, Report, hookimpl
from omnilab.api import Image, Panel, Series, Tick, ViewLayout

LAYOUT = ViewLayout([[Panel("image", "What it sees", ["seen"])], [Panel("plot", "Grey levels", ["grey"])]], widths=(2, 1))

@dataclass
class Look:
    """The grey levels of random images."""
    count: int = 4  # images
    needs: ClassVar[tuple[str, ...]] = ()
    metric_names: ClassVar[tuple[str, ...]] = ("mean",)

    def run(self, parts, record, rng):
        from matplotlib.figure import Figure
        record.log("layout", LAYOUT)
        images = rng.integers(0, 256, (self.count, 16, 16), np.uint8)
        means = images.mean((1, 2))
        for i in record.track(range(self.count), "images", self.count, lambda _: 1):
            record.log("seen", Image(images[i]), Tick(i, i * 10**9))
        steps = np.arange(self.count)
        record.log("grey", Series(means, steps, steps * 10**9, "1"))
        figure = Figure()
        figure.subplots().plot(means)
        return Report([Metric("mean", float(means.mean()), "1")], figures={"grey_levels": figure})

@hookimpl
def register_studies(register):
    register("look", Look)
'''


@pytest.mark.slow
def test_it_is_shown_as_ours_are(
    tmp_path: Path, omnilab_here: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    from rerun.chunk import RrdReader

    (tmp_path / "look.py").write_text(STUDY)
    monkeypatch.setenv("OMNILAB_PLUGINS", "look.py")
    rc, _, err = omnilab_here("~experiment", "study=look")
    assert (rc, "omnilab:" in err) == (0, False)
    run = tmp_path / "logs/latest"
    assert any(run.rglob("grey_levels.png"))
    assert {"What it sees", "Grey levels"} <= set(titles_of(json.loads((run / "foxglove_layout.json").read_text())))
    reader = RrdReader(run / "run.rrd")
    chunks = [chunk.to_record_batch().to_pydict() for chunk in reader.stream(store=reader.blueprints()[-1]).to_chunks()]
    titles = [chunk["ViewBlueprint:display_name"][0][0] for chunk in chunks if "ViewBlueprint:display_name" in chunk]
    assert {"What it sees", "Grey levels"} <= set(titles)


def titles_of(layout: dict[str, Any]) -> list[str]:
    """The titles of the panels of a layout for Foxglove."""
    return [
        str(panel["foxglovePanelTitle"]) for panel in layout["configById"].values() if "foxglovePanelTitle" in panel
    ]
