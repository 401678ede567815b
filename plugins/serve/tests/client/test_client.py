"""The client against a live service."""

from __future__ import annotations

import math

import pytest

from omnilab.client import Client
from omnilab.errors import ConfigError, DataError
from omnilab.runner.cli import main
from omnilab.runner.run_folder import find_runs

TOKEN = "a-token-of-the-tests"


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
