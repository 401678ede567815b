"""`omnilab check`: what is named of wrong components, exit codes, and what a word means."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from omnilab.errors import PluginError
from omnilab.runner.authoring import check as command
from omnilab.runner.authoring.measuring import MeasuredCost
from omnilab.runner.cli import main
from omnilab.runner.plugin_files import VARIABLE
from omnilab.runner.registry import check_component
from omnilab_appearance import Radon

WRONG = str(Path(__file__).with_name("wrong_descriptors.py"))
FAST = MeasuredCost(0.002, 5e5)


@pytest.fixture
def check(monkeypatch, capsys):
    monkeypatch.setenv(VARIABLE, "")  # and as it was afterwards
    monkeypatch.setattr(command, "built_in_costs", lambda *_: {"one": FAST, "two": FAST})

    def checked(*words):
        with pytest.raises(SystemExit) as ended:
            main(["check", *words])
        out, err = capsys.readouterr()
        return ended.value.code, out, err

    return checked


@pytest.mark.parametrize(
    ("name", "broken", "words"),
    [
        ("right", 0, ""),
        ("wide", 1, "float64, not float32"),
        ("short", 1, r"of shape \(5, 64\), not \(6, ...\)"),
        ("centered", 1, "let nothing of an image enter another's signature"),
        ("undefined", 1, "NaN or infinity"),
        ("turning", 1, "declares rotation='invariant', but .* declare 'equivariant'"),
        ("writing", 1, "writes into its input `images`.*copy it first"),
        ("holding", 1, "make a new array each time"),
        ("counting", 1, "its setting calls is another"),
    ],
)
def test_each_wrong_descriptor_is_named(check, name, broken, words):
    code, out, _ = check(WRONG, f"descriptor={name}", "--json", "--rules")
    (found,) = json.loads(out)["components"]
    failed = [rule["why"] for rule in found["rules"] if rule["state"] == "failed"]
    assert (code, found["kept"], bool(failed)) == (broken, not broken, bool(broken))
    assert not broken or any(re.search(words, why) for why in failed)


@pytest.mark.slow  # measures all built-in ones
def test_a_slow_one_is_named_beside_the_median_of_the_built_in_ones(check):
    code, out, _ = check(WRONG, "descriptor=slow", "descriptor.seconds=0.11")
    assert code == 1
    assert "times slower than the median of 2 built-in descriptors per image" in out
    assert "descriptor=slow breaks 1 of 11 rules" in out


@pytest.mark.parametrize(
    ("times", "slowest", "state"),
    [(1, 1, "ok"), (9, 1, "ok"), (12, 1, "doubted"), (99, 1, "failed"), (99, 99, "doubted")],
)
def test_how_slow_is_too_slow(times, slowest, state):
    assert command._time(MeasuredCost(0.002 * times, 0), FAST, 0.002 * slowest, "the median").state == state


def test_memory_is_said_where_it_is_much():
    assert command._memory(MeasuredCost(1, 2e6), FAST, "the median").state == "ok"
    assert command._memory(MeasuredCost(1, 8e7), FAST, "the median").state == "doubted"


def test_settings_are_those_of_a_run(check):
    code, out, _ = check("radon", "descriptor.angles=8", "--rules")
    assert (code, out.splitlines()[-1]) == (0, "descriptor=radon keeps all 9 rules")
    code, out, _ = check("radon", "descriptor.angles=6", "--rules")
    assert code == 1
    assert "6 angles hold no quarter turn" in out


def test_a_file_s_components_are_all_checked(check, tmp_path):
    file = tmp_path / "mine.py"
    source = Path(WRONG).read_text(encoding="utf-8")
    file.write_text(
        source.replace(
            "(Right, Wide, Short, Centered, Undefined, Turning, Writing, Holding, Counting, Slow)", "(Right, Wide)"
        )
    )
    code, out, _ = check(str(file), "--rules")
    assert code == 1
    assert "descriptor=right keeps all" in out
    assert "descriptor=wide breaks 1 of" in out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["radn"], "no component 'radn', and no such file or folder (did you mean radon?)"),
        (["mcap"], "'mcap' is the name of 2 components; give"),
        (["descriptor=radn"], "(did you mean descriptor=radon?)"),
        (["descripter=radon"], "'descripter' is no kind; there is sensor"),
        (["radon", "descriptor.angels=3"], "(did you mean angles?)"),
        (["radon", "descriptor.angles=3,5"], "is several values, and one component is checked at a time"),
        (["radon", "seed=1"], "says nothing of descriptor=radon; its settings are given as descriptor.NAME=VALUE"),
        (["blur", "descriptor=radon"], "its settings are given as disturbances.blur.NAME=VALUE"),
        (["sensor=folder"], "sensor.path is not set and has no default; give sensor.path=VALUE"),
        ([WRONG, "descriptor=radon"], "is not of"),
        (["nowhere.py"], "no component 'nowhere.py', and no such file"),
        ([], "nothing is named; give a component"),
    ],
    ids=lambda value: " ".join(value)[-30:] if isinstance(value, list) else "",
)  # fmt: skip
def test_bad_input_is_a_sentence(check, words, expected):
    code, out, err = check(*words)
    assert (code, out) == (2, "")
    assert expected in err


def test_a_file_that_fails_to_load_says_why(check, tmp_path):
    (tmp_path / "broken.py").write_text("import nowhere\n")
    code, _, err = check(str(tmp_path / "broken.py"))
    assert code == 2
    assert (
        "not loaded: ModuleNotFoundError: No module named 'nowhere' (omnilab plugins -v shows the traceback, with"
        in err
    )


def test_what_may_not_be_installed_is_said(check, monkeypatch):
    from omnilab.runner.authoring import choosing

    monkeypatch.setattr(choosing, "missing_distributions", lambda: ["omnilab-slam"])
    _, _, err = check("backend=gtsam_bach")
    assert "; not installed: omnilab-slam (pip install 'omnilab[slam]')" in err


# ------------------------------------------------------------------------------------------------------------ folders
def test_a_folder_is_the_plugin_s_business(check, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "radon").mkdir()
    for i in range(3):
        cv2.imwrite(str(tmp_path / "radon" / f"{i}.png"), np.random.default_rng(i).integers(0, 255, (64, 64), np.uint8))
    code, out, _ = check("./radon", "-o", str(tmp_path / "found.png"))
    assert (code, "3 images, 64 x 64" in out) == (0, True)
    assert (tmp_path / "found.png").exists()
    code, _, err = check("radon")
    assert code == 2
    assert "'radon' is a component and a path here; give descriptor=radon, or ./radon" in err


def test_help_names_both(check):
    code, out, _ = check("--help")
    assert (code, "omnilab check DIR" in out, "descriptor=radon" in out) == (0, True, True)


# ------------------------------------------------------------------------------------------------------ what is beside
def test_a_distance_is_checked_on_the_signatures_of_a_descriptor(check):
    code, out, _ = check("distance=features_turned", "descriptor=surf", "descriptor.features=30", "--rules")
    assert (code, "keeps all" in out) == (0, True)


@pytest.mark.slow
def test_an_odometry_is_checked_on_the_images_of_a_sensor(check):
    code, out, _ = check("odometry=simulated", "sensor=mirror", "sensor.size=32", "--rules")
    assert (code, "how the camera moved is not known" in out) == (0, True)


@pytest.mark.slow
def test_a_study_runs_with_parts_of_its_own(check):
    words = ("study.step_m=2", "study.query_count=3", "descriptor=tiny_image")
    code, out, _ = check("study=grid", *words, "--rules")
    assert (code, "keeps all" in out) == (0, True)


def test_names_that_are_values_are_refused():
    for name in ("nan", "null", "true"):
        with pytest.raises(PluginError, match=f"descriptor={name} is read as a value; give it another name"):
            check_component("descriptor", name, Radon)
