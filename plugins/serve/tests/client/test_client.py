"""The client against a live service."""

from __future__ import annotations

import json
import math

import pytest

from omnilab.client import Client, SubmissionRequest
from omnilab.errors import ConfigError, DataError
from omnilab.runner.cli import main
from omnilab.runner.registry import discover
from omnilab.runner.run_folder import find_runs

TOKEN = "a-token-of-the-tests"
RUN = [
    "experiment=quickstart", "study.query_count=6", "study.step_m=1.0", "sensor.size=64", "sensor.samples=1", "~sinks.rerun",
    "~sinks.mcap", "cache=off",
]  # fmt: skip


def called(*words: str) -> object:
    """The exit code of a command."""
    with pytest.raises(SystemExit) as ended:
        main(list(words))
    return ended.value.code


def test_runs_are_those_on_the_disk(serve, finished_runs):
    client = Client(serve(logs=finished_runs).url)
    runs = find_runs(finished_runs)
    page = client.runs(sort="started")
    assert page.total == len(runs) == 4
    assert sorted(run.path for run in page.runs) == [run.folder.relative_to(finished_runs).as_posix() for run in runs]
    for run in runs:
        found = client.run(run.folder.relative_to(finished_runs).as_posix())
        assert found.state == "done"
        assert {k: v for k, v in found.metrics.items() if v is not None} == {
            k: v for k, v in run.metrics.items() if not math.isnan(v)
        }
    assert client.runs("descriptor:hog").total == 1
    assert len(client.runs(limit=1, offset=3).runs) == 1


def test_the_table_of_a_server_is_the_local_one(serve, finished_runs, capsys):
    served = serve(logs=finished_runs)
    assert called("runs", str(finished_runs)) == 0
    local = capsys.readouterr().out
    assert called("runs", "--server", served.url) == 0
    assert capsys.readouterr().out == local


def test_what_is_not_there_is_a_sentence(serve):
    client = Client(serve().url)
    for ask in (client.run, client.submission):
        with pytest.raises(DataError, match="no"):
            ask("nothing")


def test_a_token_is_needed_where_the_server_has_one(serve, monkeypatch):
    url = serve(token=TOKEN).url
    with pytest.raises(ConfigError, match="a token is needed"):
        Client(url).runs()
    with pytest.raises(ConfigError, match="the token is wrong"):
        Client(url, "another-token").runs()
    assert Client(url, TOKEN).runs().total == 0
    assert Client(f"{url}/login?token={TOKEN}").runs().total == 0
    monkeypatch.setenv("OMNILAB_SERVER", url)
    monkeypatch.setenv("OMNILAB_TOKEN", TOKEN)
    assert Client().runs().total == 0


def test_a_change_is_asked_for_with_the_token_of_the_session(serve):
    served = serve()
    client = Client(served.url)
    with pytest.raises(DataError):
        client.cancel("nothing")
    served.app.state.csrf = "of another start"
    with pytest.raises(ConfigError, match="load it again"):
        client.cancel("nothing")


def test_files_of_a_run_are_downloaded_whole(serve, finished_runs, tmp_path):
    client = Client(serve(logs=finished_runs).url)
    path = client.runs().runs[0].path
    files = {file.name: file.size for file in client.files(path)}
    assert {"metrics.csv", "run.rrd", "run.log"} <= files.keys()
    for name in ("metrics.csv", "run.rrd"):
        client.download(path, name, tmp_path / name)
        assert (tmp_path / name).read_bytes() == (finished_runs / path / name).read_bytes()
        assert (tmp_path / name).stat().st_size == files[name]
    with pytest.raises(DataError, match="has no file"):
        client.download(path, "nothing.txt", tmp_path / "nothing.txt")
    assert sorted(file.name for file in tmp_path.iterdir() if file.is_file()) == ["metrics.csv", "run.rrd"]
    log = client.log(path, 3)
    assert list(log.lines) == (finished_runs / path / "run.log").read_text(encoding="utf-8").splitlines()[-3:]


def test_sweeps_are_those_on_the_disk(serve, finished_runs):
    client = Client(serve(logs=finished_runs).url)
    (sweep,) = client.sweeps()
    assert sweep.counts["done"] == 2
    assert sweep.parameters == {"seed": ["3", "4"]}


@pytest.mark.slow
def test_comparisons_and_reports_are_those_of_the_commands(serve, finished_runs, tmp_path, capsys):
    client = Client(serve(logs=finished_runs).url)
    paths = [run.path for run in client.runs(limit=2).runs]
    assert called("compare", *(str(finished_runs / path) for path in paths), "--json") == 0
    local = json.loads(capsys.readouterr().out)
    found = client.compare(paths)
    assert found["paired"] == local["paired"]
    client.report(paths[0], tmp_path / "report.html")
    assert "<html" in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_what_is_installed_is_that_of_here(served_once):
    client = Client(served_once.url)
    registry = discover("")
    found = client.components()
    assert {(one.kind, one.name) for one in found} == {(c.kind, c.name) for c in registry.components.values()}
    assert client.component("descriptor", "radon") in found
    assert {"grid", "quickstart"} <= {recipe.name for recipe in client.recipes()}
    assert client.failed_plugins() == []
    assert client.recipe("quickstart")
    assert "seed" in json.dumps(client.run_settings())


@pytest.mark.slow
def test_a_request_is_checked_in_the_builders_words(served_once):
    client = Client(served_once.url)
    found = client.check(SubmissionRequest(["experiment=quickstart", "seed=1,2"]))
    assert (found.experiment, found.jobs, found.swept) == ("quickstart", 2, {"seed": ["1", "2"]})
    with pytest.raises(ConfigError, match=r"descriptor.angles"):
        client.check(SubmissionRequest(["experiment=quickstart", "descriptor.angles=1"]))
    with pytest.raises(ConfigError, match="overrides"):
        client.check(SubmissionRequest("experiment=quickstart"))


@pytest.mark.slow
def test_a_run_is_submitted_waited_for_and_exits_as_it_did(served_once, capsys):
    served = served_once
    client = Client(served.url)
    assert called("submit", *RUN, "--server", served.url, "--wait", "seed=1") == 0
    printed = capsys.readouterr()
    identity, address = printed.out.split()
    assert address == f"{served.url}/queue/{identity}"
    submission = client.submission(identity)
    assert submission.path is not None
    assert f"{submission.path} done" in printed.err
    assert client.run(submission.path).state == "done"
    assert called("submit", *RUN, "descriptor.angles=1", "--server", served.url) == 2
    assert "descriptor.angles=1" in capsys.readouterr().err


@pytest.mark.slow
def test_the_queue_is_led_from_elsewhere(serve):
    client = Client(serve().url)
    first = client.submit(SubmissionRequest([*RUN, "study.query_count=2000"]))
    second = client.submit(SubmissionRequest([*RUN, "seed=1,2"]))
    assert client.prioritise(second.id, 5).priority == 5
    assert client.cancel(second.id).state == "cancelled"
    client.cancel(first.id)
    assert client.wait(first.id, 200).state in {"cancelled", "interrupted"}
    assert {found.id for found in client.submissions()} == {first.id, second.id}
    again = client.retry(second.id)
    sweep = client.wait(again.id, 200)
    assert (sweep.state, sweep.sweep) == ("done", True)
    assert sweep.path is not None
    assert client.sweep(sweep.path).counts["done"] == 2
    assert "seed" in client.output(again.id)
    assert client.wait(client.resume(sweep.path).id, 200).path == sweep.path
    with pytest.raises((ConfigError, DataError)):
        client.interrupt(sweep.path)
