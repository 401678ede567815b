"""Shards as jobs of parallel launchers: the bytes of the run as a whole."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from omnilab.runner.sweeps import load_sweep

SHARES = ("~experiment", "study=shares", "~sinks.rerun", "~sinks.mcap")
PLUGIN = {"OMNILAB_PLUGINS": str(Path(__file__).with_name("omnilab_shares.py"))}
RAY = ("hydra/launcher=ray", "+hydra.launcher.ray.init.include_dashboard=false")


@pytest.fixture(scope="module")
def whole(omnilab_in, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    result = omnilab_in(folder, *SHARES, "hydra.run.dir=w", env=PLUGIN)
    assert result.rc == 0, result.stderr
    return folder / "w"


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "words",
    [
        ("hydra/launcher=submitit_local",),
        (*RAY, "+hydra.launcher.ray.init.num_cpus=2"),
    ],
    ids=["submitit", "ray"],
)
def test_shards_of_a_launcher_are_the_run_as_a_whole(words, whole, omnilab_in, tmp_path):
    if "ray" in words[0] and find_spec("ray") is None:
        pytest.skip("ray is not installed: uv sync --group ray")
    result = omnilab_in(tmp_path, *SHARES, "shards=2", *words, "hydra.sweep.dir=s", env=PLUGIN, timeout=500)
    assert result.rc == 0, result.stderr
    folders = {job.settings["shard"]: job.folder for job in load_sweep(tmp_path / "s").jobs}
    assert len(folders) == 5
    for name in ("metrics.csv", "distances.csv"):
        assert (folders["all-2-of-2"] / name).read_bytes() == (whole / name).read_bytes()
