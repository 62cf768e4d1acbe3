"""What shells complete, asked as they ask."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from click.shell_completion import ShellComplete

from ibrpipe.cli.main import cli


def completed(*words: str) -> list[str]:
    """Return what the last of the words, which is not finished, may become."""
    found = ShellComplete(cli, {}, "ibrpipe", "_IBRPIPE_COMPLETE").get_completions(list(words[:-1]), words[-1])
    return [item.value if item.type == "plain" else f"<{item.type}>" for item in found]


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (["in"], ["ingest", "inspect"]),
        (["run", "ph"], ["photos", "<file>"]),
        (["run", "mesh", "--until", "re"], ["residuals", "render"]),
        (["run", "mesh", "--set", "ingest.hold"], ["ingest.hold_out_every="]),
        (["run", "mesh", "--set", "ingest.exposure=c"], ["ingest.exposure=csv"]),
        (["run", "mesh", "--set", "render.video=t"], ["render.video=true"]),
        (["run", "mesh", "--set", "geometry.surface.silh"], ["geometry.surface.silhouette_fit="]),
        (["run", "mesh", "--set", "nothing.at="], []),
        (["render", "--renderers", "e"], ["epipolar"]),
        (["render", "--renderers", "ldi:search=q"], ["ldi:search=quadtree"]),
        (["render", "--renderers", "ldi:residuals=false,sea"], ["ldi:residuals=false,search="]),
        (["render", "--renderers", "nothing:"], []),
        (["render", "--path", "o"], ["orbit", "<file>"]),
        (["export", "out", "a.glb", "--set", "tex"], ["texture="]),
        (["export", "out", "a.glb", "--set", "texture="], ["texture=png", "texture=webp"]),
        (["export", "out", "a", "--format", "imp"], ["impostors"]),
        (["schema", "renderer_s"], ["renderer_splat"]),
        (["synth", "gl"], ["glossy"]),
        (["bench", "hard-cases", "--renderers", "pre"], ["prewarp"]),
    ],
    ids=" ".join,
)  # fmt: skip
def test_words_are_completed(words: list[str], wanted: list[str]) -> None:
    assert completed(*words) == wanted


def test_commands_are_completed_without_importing_them() -> None:
    code = (
        "import sys; from click.shell_completion import ShellComplete; from ibrpipe.cli.main import cli\n"
        "found = ShellComplete(cli, {}, 'ibrpipe', '_IBRPIPE_COMPLETE').get_completions([], '')\n"
        "print(len(found), 'numpy' in sys.modules, 'pydantic' in sys.modules)"
    )
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert int(printed[0]) > 20
    assert printed[1:] == ["False", "False"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_line_of_the_docs_prints_a_script(shell: str) -> None:
    environment = {**os.environ, "_IBRPIPE_COMPLETE": f"{shell}_source"}
    code = "from ibrpipe.cli.main import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    if shell == "bash" and "Bash version" in done.stderr:
        pytest.skip("this bash is too old")
    assert f"_IBRPIPE_COMPLETE={shell}_complete" in done.stdout
