"""Every built-in component keeps every rule of the command, with its default settings; studies with small ones."""

from __future__ import annotations

import shlex

import pytest

from omnilab.errors import OmnilabError
from omnilab.runner.authoring.choosing import chosen, named
from omnilab.runner.execute import pinned
from omnilab.runner.registry import discover
from omnilab.testing.rules import FAILED, verdicts

SMALL = {
    "altitude": "study.position_count=1 study.heights_m=[0.4,1.6,0.6] study.references_m=[0.4]",
    "catchment": "study.step_m=1 study.references=3",
    "changes": "study.step_m=1 study.query_count=5 +study.conditions.higher.height_m=1.3",
    "cost": "study.step_m=1 study.query_count=5",
    "grid": "study.step_m=1 study.query_count=5",
    "joint": "study.step_m=1 study.query_count=5 study.offsets_m=[0.0,0.3]",
    "large_map": "study.steps_m=[1.0,0.5] study.query_count=5",
    "lifelong_map": "study.step_m=1 study.query_count=5 study.days=[unchanged]",
    "linearity": "study.step_m=0.3 study.references=3 study.reach_m=1",
    "live_localize": "",
    "local_map": "study.steps_m=[0.5] study.neighbours=[5] study.query_count=5 study.starts=2",
    "localize": "study.query_count=5",
    "map": "study.step_m=1",
    "matching": "study.distances_m=[0.5] study.pairs=3 study.images=40",
    "parameter_curves": "study.step_m=1 study.query_count=5 study.references=3 study.line_step_m=0.3 study.reach_m=1"
    " '+study.parameters.columns={of:descriptor.columns,values:[16,32]}' descriptor=tiny_image",
    "pose_graph": "study.walk.count=30 study.walk.side=5",
    "render": "study.step_m=2",
    "resolution": "study.side=3 study.step_m=0.5 study.query_count=5 study.settings=[rows,columns] study.sizes=[[16,32],[8,16]]",
    "robustness": "study.side=3 study.step_m=0.5 study.query_count=5 +study.levels.blur.sigma_px=[1.0]",
    "room": "study.steps_m=[0.5] study.neighbours=[4] study.query_count=3 study.starts=2 study.side=3",
    "rotations": "descriptor=radon study.distances_m=[0.0,0.5] study.pairs=3 study.step_m=0.5",
    "route_localization": "study.every=3",
    "steps": "study.steps_m=[1.0,0.5] study.query_count=5 study.heading_steps=32",
    "topological_map": "study.steps_m=[0.5] study.nodes=[5,4]",
    "trajectory": "",
    "view_count": "study.counts=[2,4] study.seeds=2",
    "view_density": "+odometry@odometries.a=guided_epipolar sensor=mirror sensor.size=200 study.every_m=0.3 study.every_rad=0.5"
    " study.similarities=[0.5] study.gains=[] study.seeds=2",
    "view_range": "study.ranges_m=[6] study.scenarios=[open] study.seeds=2 study.views=6",
    "view_slam": "+odometry@odometries.views=planar_epipolar sensor=mirror sensor.size=120 study.path=square study.every_m=0.3"
    " study.every_rad=0.5",
    "views": "",
}
NEED_A_FILE = {
    "descriptor": {"onnx"},
    "odometry": {"recorded"},
    "sensor": {"calibrated", "camera", "folder", "mcap", "ocam", "rosbag", "sequence", "video"},
}
FEW = {
    "descriptor=tiny_image",
    "distance=poc",
    "disturbance=blur",
    "localizer=smacof",
    "view_filter=view_ekf",
    "study=map",
}
COMPONENTS = [
    pytest.param(kind, name, marks=() if f"{kind}={name}" in FEW else pytest.mark.slow, id=f"{kind}={name}")
    for kind, name in discover("").components
]


def tried(kind, name, words):
    """What is wrong with a component, rule by rule, or with its settings."""
    registry = discover("")
    try:
        with pinned(1):
            found = list(verdicts(chosen(named(f"{kind}={name}", registry), words, registry).trial))
    except OmnilabError as error:
        return [str(error)]
    return [verdict.why for verdict in found if verdict.state == FAILED]


@pytest.mark.parametrize(("kind", "name"), COMPONENTS)
def test_a_built_in_component_keeps_all_rules(kind, name, tmp_path):
    words = shlex.split(SMALL[name]) if kind == "study" else []
    words += [f"study.folder={tmp_path / 'rendered'}"] * (name == "render")
    wrong = tried(kind, name, words)
    if name in NEED_A_FILE.get(kind, ()):
        assert wrong
        assert all("give " in why for why in wrong)
    else:
        assert wrong == []
