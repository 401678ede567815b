"""What a shell proposes behind `omnilab`."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ASK = """
export PATH={bin}:$PATH
eval "$(omnilab -sc install=bash)"
ask() {{
  COMP_LINE=$1 COMP_POINT=${{#1}}
  read -ra COMP_WORDS <<< "$1"
  COMP_CWORD=$(( ${{#COMP_WORDS[@]}} - 1 ))
  hydra_bash_completion
  echo "${{COMPREPLY[*]}}"
}}
ask 'omnilab ser'
ask 'omnilab experiment=grid descriptor=radon_g'
"""


@pytest.mark.parametrize(
    ("line", "proposed", "not_proposed"),
    [
        ("omnilab ", {"plugins", "repeat", "view", "experiment="}, {"radon"}),
        ("omnilab re", {"repeat", "repair", "report"}, {"plugins", "experiment="}),
        ("omnilab plugins ra", {"radon", "radon_hog"}, {"experiment="}),
        ("omnilab repeat ", set(), {"experiment=", "plugins"}),
        ("omnilab descriptor=radon cl", set(), {"claims="}),
        ("omnilab experiment=room_", {"experiment=room_occluded"}, {"experiment=grid"}),
        ("omnilab experiment=grid study.step", {"study.step_m="}, {"plugins"}),
    ],
)
def test_commands_recipes_components_and_settings_are_proposed(
    omnilab_here: Callable[..., Any], monkeypatch: pytest.MonkeyPatch,
    line: str, proposed: set[str], not_proposed: set[str],
) -> None:  # fmt: skip
    monkeypatch.setenv("COMP_LINE", line)
    monkeypatch.setenv("COMP_POINT", str(len(line)))
    rc, out, err = omnilab_here("-sc", "query=bash")
    assert (rc, err) == (0, "")
    assert proposed <= set(out.split())
    assert not_proposed.isdisjoint(out.split())


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
def test_bash_completes(tmp_path: Path) -> None:
    script = ASK.format(bin=Path(sys.executable).parent)
    done = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.stdout.splitlines() == ["serve", "descriptor=radon_gist descriptor=radon_gist_grid"], done.stderr
