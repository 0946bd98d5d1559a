"""Commands are entry points: those of mmt, and those that another package adds."""

import pytest
from command_runs import output_of, refusal
from plugin_samples import install_package

from mmt.cli import main
from mmt.core.plugins import offered

MODULE = """
import typer

group = typer.Typer(help="A group of another package.")

@group.command()
def one() -> None:
    print("one")

@group.command()
def two() -> None:
    print("two")

def alone(times: int = 2) -> None:
    print("alone " * times)
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    (tmp_path / "added_commands.py").write_text(MODULE)
    names = {
        "another": "added_commands:group",
        "model.alone": "added_commands:alone",
        "session.info": "added_commands:alone",
        "broken": "added_commands:absent",
    }
    install_package(tmp_path, monkeypatch, "added-commands", {main.GROUP: names})


def test_another_package_adds_a_group_and_a_command_of_a_group(package):
    assert output_of("another", "two") == "two\n"
    assert output_of("model", "alone", "--times", "3") == "alone alone alone \n"
    assert "alone" in output_of("model", "--help")
    assert "alone" not in output_of("device", "--help")


def test_every_command_of_mmt_has_a_help():
    for name in offered(main.GROUP):
        first = output_of(*name.split("."), "--help")
        assert "Usage: " in first
        for typers_own in ("<bool>", "<path>", "<float>", "[[", "...]...", "{"):
            assert typers_own not in first, name


def test_a_command_that_cannot_be_imported_says_so_and_leaves_the_others(package):
    assert "added_commands:absent cannot be imported" in " ".join(
        output_of("--help").replace("│", " ").split()
    )
    said = refusal("broken")
    assert "command broken: added_commands:absent cannot be imported" in said


def test_a_switch_that_is_given_a_value_is_explained():
    for value in ("true", "no", "Off"):
        said = refusal("demo", "--monitor", value)
        assert f"--monitor is a switch: give it without {value}" in said
