"""`omnilab compare`: what it shows and writes, of strangers' files too."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.image import imread

from omnilab.api import Metric

ODD = r"a_b&c%$x|y*<i>\ \x1b[31m"  # as it is shown
WORLD = "'a_b&c%$x|y*<i>\\ \x1b[31m'".replace("\x1b", "")


@pytest.fixture
def sweep(made, tmp_path):
    """2 x 3 configurations, two seeds each, one of which failed."""
    jobs = [(angles, step_m, seed) for angles in (45, 180, 90) for step_m in (0.2, 0.4) for seed in (0, 1)]
    for i, (angles, step_m, seed) in enumerate(jobs):
        rate = angles / 400 + step_m / 10 + seed / 100
        made(f"sweep/{i}", angles=angles, step_m=step_m, seed=seed, rate=rate, wall_s=angles)
    made("sweep/12", angles=7, status="failed")
    return tmp_path / "sweep"


def columns(text: str) -> list[list[str]]:
    return [re.split(r"\s{2,}", line.strip()) for line in text.splitlines()]


def test_two_configurations_side_by_side(omnilab_here, made):
    done = omnilab_here("compare", str(made("a", angles=45)), str(made("b", angles=90, rate=0.25)))
    assert (done.rc, done.stderr) == (0, "")
    lines = columns(done.stdout)
    assert ["descriptor.angles", "45", "90"] in lines
    assert ["runs", "a", "b"] in lines
    assert ["nearest_rate", "0.5 (0.4 to 0.6)", "0.25 (0.15 to 0.35)"] in lines
    assert ["error_median", "m", "1", "0.5"] in lines
    assert "no queries.csv" in done.stdout
    assert "sensor.world" not in done.stdout


def test_by_a_setting_the_others_are_held_fixed(omnilab_here, sweep):
    lines = columns(omnilab_here("compare", "sweep", "--by", "descriptor.angles", "--metrics", "nearest_rate").stdout)
    assert lines[0] == ["study.step_m", "descriptor.angles", "seeds", "nearest_rate"]
    assert [line[:3] for line in lines[2:8]] == [[s, a, "2"] for s in ("0.2", "0.4") for a in ("45", "90", "180")]
    assert lines[2][3] == "0.1375 ± 0.064"
    assert ["12", "failed", r"DataError: no \x1b[31mimages"] in lines


@pytest.mark.parametrize(("objective", "first"), [("nearest_rate", "0.2"), ("-nearest_rate", "0.4")])
def test_the_best_is_first_and_can_be_run_again(omnilab_here, sweep, objective, first):
    done = omnilab_here("compare", "sweep", "--best", objective)
    angles = "45" if objective == "nearest_rate" else "180"
    assert columns(done.stdout)[2][:3] == [angles, first, "2"]
    assert f"descriptor.angles={angles} study.step_m={first}; again: omnilab repeat sweep/" in done.stdout


def test_figures_are_drawn_and_other_files_are_left(omnilab_here, sweep):
    assert omnilab_here("compare", "sweep", "--best", "nearest_rate", "--figures", "figures").rc == 0
    files = {
        "nearest_rate_by_descriptor.angles.png", "nearest_rate_by_study.step_m.png", "nearest_rate_by_cost.png",
        "nearest_rate_by_descriptor.angles_and_study.step_m.png",
    }  # fmt: skip
    assert {path.name for path in Path("figures").iterdir()} == files
    assert all(imread(f"figures/{name}")[..., :3].std() > 0.02 for name in files), "something is drawn"
    assert omnilab_here("compare", "sweep", "--figures", "figures").rc == 0, "ours are drawn anew"
    Path("figures/nearest_rate_by_cost.png").write_bytes(b"mine")
    again = omnilab_here("compare", "sweep", "--figures", "figures")
    assert again.rc == 2
    assert "is there already, and none of our figures; give another folder" in again.stderr
    assert Path("figures/nearest_rate_by_cost.png").read_bytes() == b"mine"


def test_a_metric_without_value_is_never_the_best(omnilab_here, made):
    nothing = [Metric("nearest_rate", float("nan"), "1", note="no queries")]
    made("sweep/0", angles=1, metrics=nothing), made("sweep/1", angles=2), made("sweep/2", angles=3, rate=0.3)
    for objective, order in ("nearest_rate", "321"), ("-nearest_rate", "231"):
        lines = columns(omnilab_here("compare", "sweep", "--best", objective).stdout)
        assert [line[1] for line in lines[2:5]] == list(order)
        assert lines[4][2] == "–"


def test_files_hold_what_is_shown_and_all_digits(omnilab_here, sweep):
    done = omnilab_here("compare", "sweep", "--csv", "a.csv", "--latex", "a.tex", "--markdown", "a.md")
    assert done.stderr.splitlines() == [f"omnilab: written: a.{ending}" for ending in ("csv", "tex", "md")]
    table = pd.read_csv("a.csv")
    row = table[
        (table["descriptor.angles"] == 45) & (table["study.step_m"] == 0.2) & (table["metric"] == "nearest_rate")
    ]
    assert row[["seeds", "n", "mean", "std"]].to_numpy()[0] == pytest.approx([2, 2, 0.1375, 0.01 / 2**0.5], rel=1e-12)
    assert r"45 & 0.2 & 2 & 0.1375 ± 0.064 & 0.275 ± 0.13 \\" in Path("a.tex").read_text()
    assert "| 45" in Path("a.md").read_text()


def test_texts_of_strangers_are_texts_everywhere(omnilab_here, made, recwarn):
    metric = [Metric("rate/[/]日本", 0.5, "\x1b[1m")]
    (
        made("s/0", world=WORLD, digest="1", metrics=metric),
        made("s/1", world="'[red]${oc.env:HOME}'", digest="2", metrics=metric),
    )
    folder = made("s/2", world="-1", digest="3", metrics=metric).parent
    done = omnilab_here(
        "compare", str(folder), "--latex", "a.tex", "--markdown", "a.md", "--csv", "a.csv", "--figures", "f"
    )
    assert done.rc == 0, done.stderr
    assert "\x1b" not in done.stdout
    assert "[red]${oc.env:HOME}" in done.stdout
    assert r"a\_b\&c\%\$x|y*<i>\textbackslash" in Path("a.tex").read_text()
    assert r"a\_b\&c%\$x\|y\*\<i\>\\" in Path("a.md").read_text()
    assert "\x1b" not in Path("a.md").read_text() + Path("a.tex").read_text()
    assert sorted(path.name for path in Path("f").iterdir()) == ["rate__by_cost.png", "rate__by_sensor.world.png"]


def test_names_that_are_also_ours(omnilab_here, made):
    names = ("run", "seed", "group", "metric", "seeds", "n", "mean")
    for i in range(3):
        folder = made(f"sweep/{i}", angles=i, metrics=[Metric(name, i, "1") for name in names])
        text = "".join(f"{name}: {i}\n" for name in names if name != "seed")
        (folder / "config.yaml").write_text((folder / "config.yaml").read_text() + text)
    files = ("--csv", "a.csv", "--latex", "a.tex", "--markdown", "a.md")
    for more in [], ["--best", "-group"], ["--by", "mean"]:
        done = omnilab_here("compare", "sweep", *files, *more)
        assert done.rc == 0, done.stderr
    assert pd.read_csv("a.csv").query("metric == 'mean'")[["setting mean", "mean"]].to_numpy().tolist() == [
        [0, 0], [1, 1], [2, 2],
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["nowhere"], "holds no run"),
        (
            ["sweep", "--by", "descriptor.angle"],
            "'descriptor.angle' is no setting that differs; there is descriptor.angles, study",
        ),
        (
            ["sweep", "--best", "-nearst_rate"],
            "'nearst_rate' is no metric of these runs; there is nearest_rate, error_median (did",
        ),
        (["sweep", "--metrics", "a,b"], "'a' is no metric of these runs"),
        (["sweep/0", "--figures", "f"], "nothing differs between these runs but the seed"),
        (["sweep/12"], "none of these runs can be compared: 12 (failed DataError"),
        (
            ["sweep", "--csv", "no/such/a.csv"],
            "a.csv cannot be written (No such file or directory); give another place",
        ),
        (["sweep", "--latex", "/dev/null"], "/dev/null is no file that could be replaced"),
        (["sweep", "--markdown", "sweep"], "sweep is no file that could be replaced"),
    ],
)
def test_mistakes_are_one_sentence(omnilab_here, sweep, arguments, sentence):
    done = omnilab_here("compare", *arguments)
    assert done.rc == 2
    assert sentence in done.stderr
    assert "Traceback" not in done.stderr


def test_the_libraries_of_comparisons_are_imported_by_comparisons_only():
    script = "import sys; from omnilab.runner import cli; import omnilab.runner.hydra_app; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert not {"pandas", "scipy", "matplotlib", "jinja2"} & set(loaded)
    listed = subprocess.run(
        [sys.executable, "-c", "import sys; from omnilab.runner import cli, run_commands; print(*sys.modules)"],
        capture_output=True, text=True, check=True,
    ).stdout.split()  # fmt: skip
    assert "hydra" not in listed, "`omnilab runs` has no use for it"
