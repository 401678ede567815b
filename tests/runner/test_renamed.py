"""Names of the version before go on working, with one line that says the new one."""

from __future__ import annotations

import importlib
import importlib.util
import json
import pickle
import shutil
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omnilab import api, renamed, testing
from omnilab.runner.registry import check_component, discover

BEFORE = Path(__file__).parents[1] / "data/third_party_0_1"
SMALL = (
    "experiment=quickstart", "study.step_m=1.5", "study.query_count=10", "study.show=2", "sensor.size=64",
    "sensor.samples=1", "~sinks.rerun", "~sinks.mcap", "cache=off",
)  # fmt: skip
NAMES = {  # what modules of version 0.1.0 offered to plugins and scripts
    "omnilab.projection": """
        CentralCamera ConicalMirror CylindricalCamera EIZOH_WIDE_70 EllipticMirror EquirectangularCamera
        FisheyeCamera HyperbolicMirror ImageCircle OCamCamera PANORAMA_SHAPE ParabolicMirror PinholeCamera
        RayCamera SphericalMirror StereoCamera THESIS_HALF THESIS_WHOLE UnifiedCamera birds_eye encode
        load_camera mirror_view panorama point_cloud polar_pixels reproject save_camera to_color to_gray
        view_of
    """,
    "omnilab.graphs": """
        Arrival arrivals between check_edges check_graph check_information check_quaternions chi2
        dead_reckoning edge_chi2 inverse is_loop matrices moved residuals spanning_tree vectors
    """,
    "omnilab.graph_files": """
        Line Tag g2o_text read_graph toro_text
    """,
    "omnilab.trajectories": """
        Alignment Evaluation aligned evaluate kitti_text pairs_apart path_length relative_errors rms
        tum_text
    """,
    "omnilab.trajectory_files": """
        Trajectory read_trajectory
    """,
    "omnilab.logbook": """
        find_runs load_run LoadedRun
    """,
    "omnilab.record": """
        Recorder
    """,
    "omnilab.api": """
        Altimeter Answers Arrangement Backend CalibratedCamera Camera Circle Closures Descriptor Distance
        DistanceField Disturbance Estimate Estimates Frames Graph GridPoses Growing Heights Image Layout
        Learner Learnt Localizer LoopClosure MapMaker Match Memory Mesh Metric Motion NamedPath Odometry
        OnlineBackend Optimized Panel Parts PathPoses PlaceMap Places Plan PointCloud Pose PoseGraph
        Progress RandomPoses Record RecordedPoses Recorder Report Sensor Series Signature Signatures Sink
        Study Text Tick Tracker Unusable ViewFilter ViewLayout ViewMap
    """,
}


@pytest.fixture
def forgotten(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Modules of old names are imported as for the first time, and forgotten afterwards."""
    for module in renamed.MODULES:
        monkeypatch.delitem(sys.modules, module, raising=False)
    yield
    for module in renamed.MODULES:
        sys.modules.pop(module, None)


@pytest.mark.usefixtures("forgotten")
@pytest.mark.parametrize("module", renamed.MODULES)
def test_a_module_is_imported_by_its_old_name(module: str) -> None:
    with pytest.warns(FutureWarning, match=f"{module} is now {renamed.MODULES[module][0]}") as said:
        importlib.import_module(module)
    assert len(said) == 1


@pytest.mark.usefixtures("forgotten")
@pytest.mark.parametrize("module", NAMES)
def test_all_that_a_module_offered_is_found_in_it(module: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        found = importlib.import_module(module)
        assert [name for name in NAMES[module].split() if not hasattr(found, name)] == []
    with pytest.raises(AttributeError, match="no_such_thing"):
        _ = found.no_such_thing


@pytest.mark.parametrize(("old", "new"), renamed.API.items())
def test_a_type_of_the_contract_has_its_old_name_too(old: str, new: str) -> None:
    with pytest.warns(FutureWarning, match=f"omnilab.api.{old} is called {new} now"):
        assert getattr(api, old) is getattr(api, new)


def test_a_result_is_made_and_read_with_old_names_of_its_fields() -> None:
    with pytest.warns(FutureWarning, match="`said` of omnilab.api.Optimized is called `warnings` now"):
        found = api.Optimized(np.zeros((1, 3)), 2.0, 1.0, 3, np.ones(0), said=["too lazy"])
    assert found.warnings == ["too lazy"]
    with pytest.warns(FutureWarning, match="`said` of omnilab.api.Optimized"):
        assert found.said == found.warnings
    assert replace(found, iterations=4).warnings == ["too lazy"]
    with pytest.warns(FutureWarning, match="`learnt` of omnilab.api.Places is called `descriptor_state` now"):
        places = api.Places(api.Signatures(np.zeros((1, 2))), None, ["a"], learnt={"mean": np.ones(2)})
    assert places.descriptor_state.keys() == {"mean"}
    assert pickle.loads(pickle.dumps(places)).keys == ["a"]


def test_a_conformance_check_has_its_old_name_too() -> None:
    with pytest.warns(FutureWarning, match="check_map_maker is called check_embedder now"):
        assert testing.check_map_maker is testing.check_embedder


# ------------------------------------------------------------------------------------------------- plugins of before
@pytest.mark.slow
def test_a_plugin_of_before_runs_as_a_file(
    omnilab_here: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = shutil.copy(BEFORE / "omnilab_tiny.py", tmp_path / "mine.py")
    monkeypatch.setenv("OMNILAB_PLUGINS", file.name)
    rc, out, err = omnilab_here(*SMALL, "descriptor=tiny")
    assert rc == 0, err
    assert "nearest_rate" in out
    lines = [line for line in err.splitlines() if "turned" in line]
    assert lines == [
        (
            "omnilab: plugin 'mine' (mine.py): descriptor 'tiny' declares turned='shifts', which is called"
            " rotation='equivariant' now"
        )
    ]


@pytest.mark.slow
def test_a_plugin_of_before_runs_as_a_distribution(
    omnilab: Callable[..., Any], installed: Callable[[Path], Path]
) -> None:
    rc, out, err = omnilab(*SMALL, "descriptor=tiny", env={"PYTHONPATH": str(installed(BEFORE))})
    assert rc == 0, err
    assert "nearest_rate" in out
    assert err.count("declares turned='shifts', which is called rotation='equivariant' now") == 1


def test_its_own_conformance_test_goes_on_passing(imported: Callable[[Path], Any]) -> None:
    tiny = imported(BEFORE / "omnilab_tiny.py").Tiny
    testing.check_descriptor(tiny())
    assert tiny.rotation == "equivariant"


ODOMETRY = """
from dataclasses import dataclass
from omnilab import hookimpl

@dataclass
class Wheels:
    \"\"\"Wheels.\"\"\"
    def look(self, frames): ...
    def motion(self, before, now, rng): ...

@hookimpl
def register_odometries(register):
    register("wheels", Wheels)
"""


def test_a_component_with_methods_of_before_is_told_their_new_names(tmp_path: Path) -> None:
    (tmp_path / "wheels.py").write_text(ODOMETRY)
    (failure,) = discover(f"none,{tmp_path / 'wheels.py'}").failures
    assert "lacks extract, estimate" in failure.sentence
    assert "`look` is called `extract` now; `motion` is called `estimate` now" in failure.sentence


def test_a_descriptor_with_nonsense_is_not_adapted() -> None:
    from dataclasses import dataclass

    @dataclass
    class Odd:
        """Odd."""

        view, color, turned, default_distance = "mirror", False, "sideways", "poc"

        def describe(self, images): ...

    with pytest.raises(
        Exception, match=r"lacks rotation \(`turned` is called `rotation` now; rotation is one of equivariant, "
    ):
        check_component("descriptor", "odd", Odd)


# ---------------------------------------------------------------------------------------------- names that users type
@pytest.mark.slow
def test_a_component_is_chosen_by_its_old_name(omnilab_here: Callable[..., Any], tmp_path: Path) -> None:
    rc, _, err = omnilab_here(*SMALL, "localizer=filter")
    assert rc == 0, err
    assert "omnilab: localizer 'filter' is called 'bayes_filter' now; write localizer=bayes_filter" in err.splitlines()
    rc, out, err = omnilab_here("plugins", "verified")
    assert (rc, err) == (0, "")
    assert "loop_closure=geometric_verification" in out


FILTER = """
from dataclasses import dataclass
from omnilab import hookimpl
from omnilab_appearance import Nearest

@dataclass
class Filter(Nearest):
    \"\"\"A filter of someone else.\"\"\"

@hookimpl
def register_localizers(register):
    register("filter", Filter)
"""


@pytest.mark.slow
def test_a_component_of_today_is_not_hidden_by_an_old_name(
    omnilab_here: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.py").write_text(FILTER)
    monkeypatch.setenv("OMNILAB_PLUGINS", "mine.py")
    assert discover().get("localizer", "filter").plugin.name == "mine"
    rc, _, err = omnilab_here(*SMALL, "localizer=filter")
    assert rc == 0, err
    assert "is called" not in err
    manifest = json.loads((tmp_path / "logs/latest/manifest.json").read_text())
    assert manifest["components"]["localizer"]["distribution"] == "mine.py"


def test_an_old_name_is_not_listed(omnilab_here: Callable[..., Any]) -> None:
    rc, out, _ = omnilab_here("--help")
    assert rc == 0
    assert "bayes_filter" in out
    assert " filter," not in out


@pytest.mark.parametrize(
    ("package", "old", "new"),
    [
        ("omnilab_appearance", "Filter", "BayesFilter"),
        ("omnilab_appearance", "Verified", "GeometricVerification"),
        ("omnilab_studies", "MakeMap", "MapStudy"),
        ("omnilab_studies", "Trajectory", "TrajectoryStudy"),
    ],
)
def test_a_class_of_a_plugin_has_its_old_name_too(package: str, old: str, new: str) -> None:
    found = importlib.import_module(package)
    with pytest.warns(FutureWarning, match=f"{package}.{old} is called {new} now"):
        assert getattr(found, old) is getattr(found, new)
