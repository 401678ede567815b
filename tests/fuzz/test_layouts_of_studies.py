"""Layouts of all studies, by their tiny runs: no panel is empty, in either viewer."""

import json
from dataclasses import fields

import cv2
import numpy as np
import pytest
from fuzz_runs import BASES, PATH, configured
from fuzz_settings import registered
from mcap.reader import make_reader

from omnilab import api
from omnilab.errors import DataError
from omnilab.runner.build import build
from omnilab.runner.recorder import Recorder
from omnilab_mcap import McapSink
from omnilab_rerun import RerunSink

SHOWN = {  # by kind of panel: what it shows
    "map": (api.PlaceMap, api.DistanceField, api.Estimate, api.Answers, api.Pose, api.Mesh, api.PointCloud, api.Graph),
    "image": (api.Image, api.Signature),
    "plot": (api.Series,),
    "text": (api.Text,),
    "log": (api.Text,),
}
TAKEN = {
    "3D": {"foxglove.SceneUpdate", "foxglove.PointCloud", "foxglove.PosesInFrame", "foxglove.PoseInFrame"},
    "Image": {"foxglove.CompressedImage", "foxglove.RawImage"},
    "Plot": {"omnilab.Scalar"},
    "RosOut": {"foxglove.Log"},
}
SOMETIMES = {"closures", "walls", "cloud"}  # logged where there is a loop, a wall, a sensor with depth


class Kept:
    """A sink that remembers what was logged where."""

    def __init__(self):
        self.records, self.layout = {}, None

    def open(self, folder):
        pass

    def write(self, path, record, tick):
        if isinstance(record, api.ViewLayout):
            self.layout = record
        else:
            self.records.setdefault(path.strip("/"), set()).add(type(record))

    def shows(self, panel):
        """Whether something was logged that a panel shows."""
        return any(
            issubclass(kind, SHOWN[panel.kind])
            for path, kinds in self.records.items()
            if any(under(path, content) for content in panel.contents)
            for kind in kinds
        )

    def flush(self):
        pass

    def close(self):
        pass


def run_of(name, registry, folder, **more):
    """What the tiny run of a base logs; its log of Foxglove is in the folder, with those of `more` sinks."""
    run = build(configured(BASES[name], registry), registry)
    given = {each.name: getattr(run, each.name) for each in fields(api.Parts) if hasattr(run, each.name)}
    own = {key: registry.get("distance", d.default_distance).cls() for key, d in run.descriptors.items()}
    kept = Kept()
    with Recorder({"kept": kept, "mcap": McapSink(), **more}, folder) as record:
        report = run.study.run(api.Parts(**given, default_distances=own), record, np.random.default_rng(run.seed))
        record.log("summary", api.Text(report.summary, markdown=True))
    return kept


def under(path, content):
    return f"{path}/".startswith(f"{content.strip('/')}/")


@pytest.mark.slow
@pytest.mark.parametrize("name", BASES)
def test_every_panel_of_a_study_shows_something(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "path.csv").write_text(PATH)
    kept = run_of(name, registered(), tmp_path)
    panels = [panel for column in kept.layout.columns for panel in column]
    empty = {panel.title for panel in panels if not kept.shows(panel)}
    missing = {path for panel in panels for path in panel.contents if not any(under(it, path) for it in kept.records)}
    assert (empty, missing - SOMETIMES) == (set(), set())
    check_foxglove(tmp_path)


def check_foxglove(folder):
    with (folder / "run.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    schemas = {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}
    layout = json.loads((folder / "foxglove_layout.json").read_text())
    for name, panel in layout["configById"].items():
        kind = name.split("!")[0]
        match kind:
            case "3D":
                topics = list(panel["topics"])
            case "Image":
                topics = [panel["imageMode"]["imageTopic"]]
            case "Plot":
                topics = [path["value"].removesuffix(".value") for path in panel["paths"]]
            case "RosOut":
                topics = [panel["topicToRender"]]
        assert {schemas[topic] for topic in topics} <= TAKEN[kind]
        assert topics


def parts(picture, layout):
    """The inner part of each panel of a picture, by its title."""
    rows, columns = picture.shape[:2]
    shares = np.cumsum([0, *(layout.widths or [1] * len(layout.columns))], dtype=float)
    for panels, left, right in zip(layout.columns, shares, shares[1:], strict=False):
        x0, x1 = (np.array([left, right]) / shares[-1] * columns).astype(int)
        edges = np.linspace(0.045, 0.965, len(panels) + 1) * rows  # above the time panel; the run has no header
        for panel, top, bottom in zip(panels, edges, edges[1:], strict=False):
            inner = slice(int(top + 0.035 * rows), int(bottom - 0.02 * rows))  # below the title
            yield panel.title, picture[inner, x0 + 8 : x1 - 8]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["localization", "graph", "views"])
def test_no_panel_of_a_picture_is_blank(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "path.csv").write_text(PATH)
    kept = run_of(name, registered(), tmp_path, rerun=RerunSink())
    try:
        RerunSink().view(tmp_path, screenshot=tmp_path / "seen.png")
    except DataError as error:
        if "Vulkan" in str(error):
            pytest.skip(str(error))
        raise
    picture = cv2.imread(str(tmp_path / "seen.png"))
    blank = [title for title, part in parts(picture, kept.layout) if len(np.unique(part.reshape(-1, 3), axis=0)) < 8]
    assert not blank
