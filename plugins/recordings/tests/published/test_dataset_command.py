"""Published sets: what is shipped, copies that are whole and that are not, conversions beside what was written."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from omnilab.api import GridPoses, RecordedPoses
from omnilab.errors import ConfigError, DataError
from omnilab_recordings import Folder
from omnilab_recordings.published.conversions import form_of, prepare
from omnilab_recordings.published.dataset_command import dataset
from omnilab_recordings.published.published_set import published_set, shipped_names

DATA = Path(__file__).parents[5] / "shared/data"


def picture(file, value=1):
    file.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(file), np.full((25, 120), value, np.uint8))


@pytest.fixture
def drive(tmp_path):
    """A made-up copy of the Sussex repository: a drive of 1 m/s along its y, a test with a hole in its track."""
    root = tmp_path / "copy"
    images, tracks = root / "scripts/robot_data", root / "scripts/tracking_data"
    tracks.mkdir(parents=True)
    for i in range(455):
        picture(images / f"snapshot_{i}.png", i % 200)
    times = "".join(f"{0.1 * i:.3f}, outdoor/snapshot_{i}.png\n" for i in range(455))
    (images / "training.csv").write_text(f"Time [s], Filename\n{times}")
    (tracks / "training_path_scaled.csv").write_text("".join(f"{50 * i},{5 * i - 100},{-20}\n" for i in range(1000)))
    for i in range(4):
        picture(images / f"test_{i}.png")
    lines = "".join(f"{1.5 * i}, 3 deg, 27017.6, test_{i}.png\n" for i in range(4))
    (images / "testing_infomax.csv").write_text(
        f"Time [s], Best heading [degrees], Lowest difference, Filename\n{lines}"
    )
    track = [t for t in range(0, 4600, 50) if not 1000 < t < 2000]
    (tracks / "testing_path_infomax_scaled.csv").write_text("".join(f"{t},{t / 10},0\n" for t in track))
    return root


@pytest.mark.parametrize("name", shipped_names())
def test_what_is_shipped_says_where_it_is_had_and_whether_its_names_are_known(name, capsys):
    known = published_set(name)
    assert re.match(r"verified by |not verified$", known.naming)
    assert all((known.title, known.where, known.licence, known.cite))
    assert known.forms or known.notes
    for form in known.forms:
        for conversion in form.conversions:
            if conversion.names is not None:
                Folder("x", positions=None, **conversion.names)  # its settings can be
    assert dataset(["list", name]) == 0
    assert known.where in capsys.readouterr().out


def test_a_drive_with_its_track_is_what_was_driven(drive, tmp_path, capsys):
    assert dataset(["check", "sussex_route", str(drive)]) == 0
    assert dataset(["prepare", "sussex_route", str(drive), str(tmp_path / "out")]) == 0
    assert "455 images, 455 of them with positions" in capsys.readouterr().out.replace("\n", " ")
    plan = Folder(str(tmp_path / "out/training"), panorama="strip").plan(RecordedPoses())
    seconds = 0.1 * np.arange(455)
    np.testing.assert_allclose(plan.T_world_camera[:, 0, 3], -0.2)
    np.testing.assert_allclose(plan.T_world_camera[:, 1, 3], seconds - 1, atol=1e-6)
    truth = (tmp_path / "out/test_a/truth.csv").read_text().splitlines()
    known = [line.split(",") for line in truth[1:]]
    assert [line[0] for line in known] == [f"images/test_{i}.png" for i in (0, 2, 3)]
    np.testing.assert_allclose(
        [[float(value) for value in line[1:]] for line in known], [[0, 0, 0], [0, 3, 3], [0, 4.5, 4.5]], atol=1e-6
    )
    assert len(list((tmp_path / "out/test_a/images").iterdir())) == 4


def test_what_is_no_copy_is_said(drive, tmp_path, capsys):
    (drive / "scripts/robot_data/snapshot_7.png").unlink()
    assert dataset(["check", "sussex_route", str(drive)]) == 2
    assert "snapshot_*.png: 454 of 455 are there" in capsys.readouterr().out
    with pytest.raises(DataError, match=r"is no whole copy of sussex_route .*: .*454 of 455 are there; complete it"):
        prepare(published_set("sussex_route"), drive, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    for arguments, sentence in (
        (["check", "sussex", str(drive)], r"no data set 'sussex', did you mean sussex_route|no data set 'sussex'"),
        (["check", "sussex_route", str(tmp_path / "nowhere")], "does not exist; download the set"),
        (["check", "panoramis", str(drive)], "panoramis has no conversion here"),
    ):
        with pytest.raises((ConfigError, DataError), match=sentence):
            dataset(arguments)


def test_nothing_is_written_over(drive, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/mine.txt").write_text("x")
    with pytest.raises(ConfigError, match="holds something already; give a new folder"):
        prepare(published_set("sussex_route"), drive, tmp_path / "out")
    assert (tmp_path / "out/mine.txt").read_text() == "x"


def test_another_version_is_said(drive, tmp_path):
    table = drive / "scripts/robot_data/training.csv"
    table.write_text(table.read_text().replace("Filename", "File"))
    with pytest.raises(DataError, match=r"has no column Filename, only Time \[s\], File; is it another version"):
        prepare(published_set("sussex_route"), drive, tmp_path / "out")


def test_names_become_positions(tmp_path):
    root = tmp_path / "seq1_cloudy1"
    for i in range(3):
        picture(root / "omni_cam" / f"t115223456{i}.5_x{0.5 * i}_y-1.25_a{0.1 * i:.1f}.jpeg")
    lines = prepare(published_set("cold"), root, tmp_path / "out")
    assert "3 images, 3 of them with positions" in lines[0]
    plan = Folder(str(tmp_path / "out"), panorama="strip").plan(RecordedPoses())
    np.testing.assert_allclose(plan.T_world_camera[:, :2, 3], [[0, -1.25], [0.5, -1.25], [1, -1.25]])
    np.testing.assert_allclose(np.arctan2(plan.T_world_camera[:, 1, 0], plan.T_world_camera[:, 0, 0]), [0, 0.1, 0.2])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("title: [", "is no YAML"),
        ("title: a", "lacks where, licence, cite, naming, which a PublishedSet needs"),
        ("{title: a, where: b, licence: c, cite: d, naming: e, wher: f}", "has 'wher', which a PublishedSet does not"),
        ("{title: a, where: b, licence: c, cite: d, naming: e, forms: [{about: f, files: [], conversions: [{folder: ../x, images: '*', names: {}}]}]}", "which leads out of its folder"),
        ("{title: a, where: b, licence: c, cite: d, naming: e, forms: [{about: f, files: [], conversions: [{folder: x, images: '*'}]}]}", "give names, table or tour"),
    ],
)  # fmt: skip
def test_a_description_of_ones_own_that_is_none_is_a_sentence(text, sentence, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    with pytest.raises(DataError, match=sentence):
        published_set(str(file))


@pytest.mark.skipif(not (DATA / "bearingnet_forest_grid").is_dir(), reason="the forest is not here")
def test_the_forest_is_a_grid(tmp_path):
    prepare(published_set("bearingnet_forest"), DATA / "bearingnet_forest_grid", tmp_path / "out")
    sensor = Folder(str(tmp_path / "out"), circle_px=[512, 512, 455, 150])
    assert len(sensor.plan(GridPoses(every=1))) == 100


@pytest.mark.skipif(not (DATA / "sussex_route").is_dir(), reason="the route is not here")
def test_the_route_in_one_table_is_two_drives():
    form, lacking = form_of(published_set("sussex_route"), DATA / "sussex_route")
    assert (form.about, lacking) == ("images in a folder a drive, beside one table of them all", [])
