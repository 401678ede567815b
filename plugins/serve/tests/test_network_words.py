"""What may not come over the network: options, Hydra's own settings, insertions, places elsewhere, bombs."""

import subprocess
import sys

import pytest

from omnilab.runner.registry import discover
from omnilab_serve.composing import SettingError
from omnilab_serve.composing.checking import CHECKED, check

QUICK = "experiment=quickstart"


@pytest.fixture(scope="module")
def registry():
    return discover()


@pytest.fixture
def checked(registry, tmp_path, monkeypatch):
    """Checks words as those of a request; files may be read from `allowed`."""
    for name in ("allowed", "logs", "secret"):
        (tmp_path / name).mkdir()
    (tmp_path / "secret/world.yaml").write_text("secret: true\n")
    (tmp_path / "secret/a.png").write_bytes(b"")
    (tmp_path / "allowed/link").symlink_to(tmp_path / "secret/world.yaml")
    monkeypatch.chdir(tmp_path)

    def checked(*words, launcher="basic"):
        return check(registry, list(words), launcher, str(tmp_path / "logs"), [str(tmp_path / "allowed")])

    return checked


@pytest.mark.parametrize(
    ("word", "sentence"),
    [
        ("--config-dir=/tmp", "is an option"),
        ("-m", "is an option"),
        ("map=s3://bucket/map.npz", "would be fetched with the rights of the service"),
        ("sensor.world='FILE:///etc/passwd',room", "would be fetched with the rights of the service"),
        ("-cd", "is an option"),
        ("hydra.run.dir=/tmp/x", "sets Hydra itself"),
        ("+hydra.job.env_set.PATH=/tmp", "sets Hydra itself"),
        ("hydra={launcher:{_target_:os.system}}", "sets Hydra itself"),
        ("~hydra", "sets Hydra itself"),
        ("+study@hydra.job=grid", "sets Hydra itself"),
        ("hydra/launcher=joblib", "sets Hydra itself"),
        ("hydra/job_logging=default", "sets Hydra itself"),
        ("hydra.launcher._target_=os.system", "sets Hydra itself"),
        ("hydra.mode=MULTIRUN", "sets Hydra itself"),
        ("sensor.world=${oc.env:HOME}", "inserts what"),
        ("sensor.world=a\\${seed}", "inserts what"),
        ("logs=elsewhere", "runs go to the logs of the service"),
        ("++logs=elsewhere", "runs go to the logs of the service"),
        ("resume=logs/a", "a sweep is resumed on its page"),
        ("descriptor=../../../tmp/evil", "is a path"),
        ("descriptor=[radon,../x]", "is a path"),
        ("+experiment@x=/tmp/evil", "is a path"),
        ("cache=../elsewhere", "written to outside of the logs"),
        ("cache=/tmp/elsewhere", "written to outside of the logs"),
        ("cache=choice(cache,'/tmp/elsewhere')", "written to outside of the logs"),
        ("cache=a,/tmp/elsewhere", "written to outside of the logs"),
        ("cache=~/elsewhere", "written to outside of the logs"),
        ("sensor.world=/etc/passwd", "is read from /etc/passwd"),
        ("sensor.world='/etc/passwd'", "is read from /etc/passwd"),
        ("sensor.world=room,/etc/passwd", "is read from /etc/passwd"),
        ("sensor.world=choice(room,'/etc/passwd')", "is read from /etc/passwd"),
        ("+sensors.a={world:/etc/passwd}", "is read from /etc/passwd"),
        ("sensor.world=~/secret.yaml", "is read from"),
        ("sensor.world=allowed/../secret/world.yaml", "is read from"),
        ("sensor.world=secret/world.yaml", "is read from"),
        ("sensor.world=allowed/link", "is read from"),
        ("map=/proc/self/environ", "is read from"),
        ("seed=range(0,1e12)", "more than 10000 values"),
        ("seed=range(0,10,0)", "steps of 0"),
        ("seed=shuffle(range(0,1e12))", "more than 10000 values"),
        ("seed=" + "[" * 3000 + "]" * 3000, "more than 100 brackets"),
        ("sensor.world=/etc/\0passwd", "NUL"),
        ("sensor.world=\ud800", "no text in UTF-8"),
        ("\ud800=1", "no text in UTF-8"),
        ("seed=" + "1" * 9000, "characters"),
    ],
)  # fmt: skip
def test_words_that_could_do_harm_are_refused(checked, word, sentence):
    with pytest.raises(SettingError, match=sentence):
        checked(QUICK, word)


@pytest.mark.parametrize(
    "words",
    [
        ["experiment=render", "study.folder=/tmp/data"],
        ["experiment=render", "study.folder=data"],
        ["experiment=render", "study.folder=logs/../data"],
        ["experiment=view_slam", "study.keep=views.npz"],
    ],
)
def test_what_is_written_is_written_into_the_logs(checked, words):
    with pytest.raises(SettingError, match="is written to outside of the logs"):
        checked(*words)
    checked("experiment=render", "study.folder=logs/data")


@pytest.mark.parametrize(
    "words",
    [[], ["experiment=quickstart", "experiment=grid"], ["experiment=quickstart,grid"], ["experiment=mine"], ["seed=1"],
     ["+experiment=grid"], ["~experiment"]],
)  # fmt: skip
def test_there_is_exactly_one_shipped_experiment(checked, words):
    with pytest.raises(SettingError, match="experiment"):
        checked(*words)


def test_a_link_beside_a_folder_does_not_lead_out(checked, tmp_path):
    (tmp_path / "allowed/positions.csv").symlink_to(tmp_path / "secret/world.yaml")
    with pytest.raises(SettingError, match="positions leads to"):
        checked("experiment=recorded_grid", "sensor.path=allowed", "sensor.positions=positions.csv")


def test_many_overrides_are_refused(checked):
    with pytest.raises(SettingError, match="give up to 200"):
        checked(QUICK, *["seed=1"] * 300)


def test_what_does_no_harm_is_taken(checked, tmp_path):
    (tmp_path / "radon").mkdir()  # a component is no file, whatever is called so
    found = checked(
        QUICK, "descriptor=radon,hog", "seed=range(0,100)", "hydra.launcher.n_jobs=2", "cache=other", "~sinks.rerun",
        "disturbance=[blur,occlusion]", launcher="joblib",
    )  # fmt: skip
    assert (found["experiment"], found["jobs"]) == ("quickstart", 200)
    assert found["command"][0] == "-m"
    assert found["command"][-1] == "hydra/launcher=joblib"
    assert len(found["swept"]["seed"]) == 100 > CHECKED


def test_a_launcher_that_is_not_installed_is_said(checked):
    with pytest.raises(SettingError, match="launcher 'nonsense' does not exist"):
        checked(QUICK, "seed=1,2", launcher="nonsense")
    with pytest.raises(SettingError, match="is no name"):
        checked(QUICK, "seed=1,2", launcher="a hydra.run.dir=/tmp")


@pytest.mark.parametrize(
    ("words", "setting"),
    [
        (["study.step_m=0.2,-1"], "study.step_m"),
        (["descriptor=hogg"], "descriptor"),
        (["sensor.size=huge"], "sensor.size"),
        (["sensor.sise=100"], "sensor.sise"),
        (["nonsense"], "nonsense"),
        (["descriptor.angles=1", "seed=3"], "descriptor.angles"),
        (["~sinks.nothing"], "sinks.nothing"),
    ],
)
def test_the_setting_is_named_that_a_sentence_is_about(checked, words, setting):
    with pytest.raises(SettingError) as refused:
        checked(QUICK, *words)
    assert refused.value.setting == setting


def test_a_setting_without_a_value_is_named(checked):
    with pytest.raises(SettingError, match="path is not set") as refused:
        checked("experiment=recorded_grid")
    assert refused.value.setting == "sensor.path"


@pytest.mark.slow
def test_sentences_are_those_of_the_command_line(checked):
    for word in ("descriptor=hogg", "study.step_m=-1", "~sinks.nothing"):
        done = subprocess.run(
            [sys.executable, "-m", "omnilab", QUICK, word], capture_output=True, text=True, check=False
        )
        with pytest.raises(SettingError) as refused:
            checked(QUICK, word)
        assert done.stderr == f"omnilab: {refused.value}\n"
