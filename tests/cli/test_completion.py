"""Shell completion, asked as bash asks."""

from __future__ import annotations

import pytest

from quadid_logs.cli import main
from quadid_logs.cli.completion import autopilots, axes, finding_codes, scenarios, structures
from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.settings import STRUCTURES


def completed(words: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return what bash would offer for the last word."""
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split(" ")) - 1))
    monkeypatch.setenv("_QUADID_LOG_COMPLETE", "complete_bash")
    with pytest.raises(SystemExit) as left:
        main([])
    assert left.value.code == 0
    return capsys.readouterr().out.split()


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("quadid-log an", ["analyze"]),
        ("quadid-log analyze --struc", ["--structure"]),
        ("quadid-log analyze --structure quad", ["quadrotor-6"]),
        ("quadid-log explain QL50", ["QL501", "QL503", "QL504", "QL505", "QL506", "QL507", "QL509"]),
        ("quadid-log simulate two", ["two-flights"]),
        ("quadid-log plan --axis ", ["roll", "pitch", "yaw"]),
    ],
)
def test_the_tab_key_offers_verbs_options_and_values(
    words: str, offered: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What begins like the word, and nothing else."""
    assert completed(words, capsys, monkeypatch) == offered


@pytest.mark.parametrize(
    ("shell", "mark"), [("bash", "complete -o"), ("zsh", "#compdef"), ("fish", "complete --command")]
)
def test_the_script_of_every_common_shell_can_be_shown(
    shell: str, mark: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It calls the program back; which shell runs the tests makes no difference."""
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    with pytest.raises(SystemExit) as left:
        main(["--show-completion", shell])
    assert left.value.code == 0
    script = capsys.readouterr().out
    assert mark in script
    assert "_QUADID_LOG_COMPLETE" in script


def test_everything_that_exists_is_offered() -> None:
    """Nothing is listed twice by hand."""
    assert [code for code, _ in finding_codes("")] == list(CATALOGUE)
    assert [name for name, _ in structures("")] == list(STRUCTURES)
    assert {"sysid-quad-x", "paper"} <= {name for name, _ in scenarios("")}
    assert [name for name, _ in autopilots("")] == ["ardupilot", "betaflight", "crazyflie", "px4"]
    assert [name for name, _ in axes("y")] == ["yaw"]
