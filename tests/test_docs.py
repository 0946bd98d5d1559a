"""The documentation against the program: links, commands, keys, and code that runs."""

import re
import shlex
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from operator import attrgetter
from pathlib import Path
from typing import Any, cast, get_args

import pytest
import typer
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from mmt.cli import follower, leader, main
from mmt.scene import Scene
from mmt.scene.files import example_scenes
from mmt_lab.harness.experiment import listed
from mmt_share.commands import listener

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
INDEX = DOCS / "index.md"
BENCH_PAGE = DOCS / "reference" / "bench.md"
COMMANDS_PAGE = DOCS / "reference" / "commands.md"
SCENE_PAGE = DOCS / "reference" / "scene.md"
PAGES = [ROOT / f"{name}.md" for name in ("README", "CHANGELOG", "CONTRIBUTING")]
PAGES += sorted(DOCS.rglob("*.md"))
RUNNABLE = [ROOT / "README.md", *sorted((DOCS / "how-to").glob("*.md"))]
LARGEST_IMAGE_BYTES = 150_000

PROGRAMS = {
    "mmt": typer.main.get_command(main.app),
    "mmt-leader": typer.main.get_command(leader.app),
    "mmt-follower": typer.main.get_command(follower.app),
    "mmt-listen": typer.main.get_command(listener.app),
}


def name_of(page):
    return str(page.relative_to(ROOT))


def fenced(text, *languages):
    """Yield (line, content) of the fenced blocks in these languages."""
    for match in re.finditer(r"^```(\w*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        if match[1] in languages:
            yield text.count("\n", 0, match.start()) + 2, match[2]


def without_fences(text):
    return re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)


def anchors(text):
    """Return the anchors that GitHub gives to the headings."""
    headings = re.findall(r"^#+ +(.+?) *$", without_fences(text), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


def sections(text):
    """Return the text below each second-level heading, by the heading without backticks."""
    parts = re.split(r"^## +(.+?) *$", text, flags=re.MULTILINE)[1:]
    return {parts[i].replace("`", ""): parts[i + 1] for i in range(0, len(parts), 2)}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_relative_link_resolves(page):
    def leads_somewhere(target):
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        return file.exists() and (not anchor or anchor in anchors(file.read_text("utf-8")))

    targets = re.findall(r"\]\(([^)\s]+)\)", without_fences(page.read_text("utf-8")))
    inside = [target for target in targets if not re.match(r"[a-z]+:", target)]
    assert [target for target in inside if not leads_somewhere(target)] == []


def test_the_index_leads_to_every_page():
    targets = re.findall(r"\]\(([^)#\s]+)", INDEX.read_text("utf-8"))
    reached = {(DOCS / target).resolve() for target in targets}
    assert set(DOCS.rglob("*.md")) - reached == {INDEX}


def test_every_decision_has_a_number_of_its_own_in_file_title_and_index():
    pages = sorted((DOCS / "decisions").glob("*.md"))
    numbers = [page.name[:4] for page in pages]
    titles = [re.match(r"# (\d+)\. ", page.read_text("utf-8")) for page in pages]
    listed = re.findall(
        r"^- \[(\d+)\. .+\]\(decisions/(\d{4})-", INDEX.read_text("utf-8"), re.MULTILINE
    )
    assert len(set(numbers)) == len(numbers)
    assert [title and f"{int(title[1]):04}" for title in titles] == numbers
    assert [(f"{int(shown):04}", number) for shown, number in listed] == [(n, n) for n in numbers]


def test_the_readme_is_short_and_pictures_are_small_and_used():
    assert len((ROOT / "README.md").read_text("utf-8").split()) <= 900
    text = "".join(page.read_text("utf-8") for page in PAGES)
    pictures = list((DOCS / "images").iterdir())
    assert pictures
    for picture in pictures:
        assert picture.name in text
        assert picture.stat().st_size <= LARGEST_IMAGE_BYTES


@pytest.mark.parametrize(
    "page",
    [page for page in RUNNABLE if "```python" in page.read_text("utf-8")],
    ids=name_of,
)
def test_the_python_code_runs(page, tmp_path, monkeypatch):
    """The blocks of a page are one program, run in an empty folder; what they register goes."""
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__main__"}
    for line, block in fenced(page.read_text("utf-8"), "python"):
        padded = "\n" * (line - 1) + block  # so that a traceback names the page's own line
        exec(compile(padded, str(page), "exec"), names)


def written_commands(text):
    """Yield the words of every command that names one of the programs."""
    lines = [line for _, block in fenced(text, "sh") for line in block.splitlines()]
    lines += re.findall(r"`([^`\n]+)`", without_fences(text))
    for line in lines:
        command = re.match(r"(?:[A-Z_]+=\S+ +)*(mmt(?:-leader|-follower|-listen)?(?: .*)?)$", line)
        if command is not None:
            yield shlex.split(command[1], comments=True)


def find(words):
    """Return the command that the words name, and what is left of them."""
    command, rest = PROGRAMS[words[0]], words[1:]
    while rest and re.match(r"[a-z]", rest[0]) and subcommands(command):
        assert rest[0] in subcommands(command), f"{' '.join(words)}: no command {rest[0]!r}"
        command, rest = subcommand(command, rest[0]), rest[1:]
    return command, rest


@cache
def subcommands(command):
    """Return the names of a group's commands, some of which it loads when they are asked for."""
    return list(command.list_commands(None)) if hasattr(command, "commands") else []


@cache
def subcommand(command, name):
    return command.get_command(None, name)


def options(command):
    return {
        name
        for parameter in command.params
        for name in (*parameter.opts, *parameter.secondary_opts)
        if name.startswith("--")
    }


def leaves(words, command):
    """Yield the commands of the reference; experiments come and go, and tell their own options."""
    if words == ("mmt", "lab") or not subcommands(command):
        yield " ".join(words), command
        return
    for name in subcommands(command):
        yield from leaves((*words, name), subcommand(command, name))


def test_a_command_that_does_not_exist_would_be_found():
    text = "`mmt nothing`\n\n```sh\nMMT_LINK__PORT=1 mmt session info FILE --none  # comment\n```\n"
    first, second = written_commands(text)
    assert first == ["mmt", "session", "info", "FILE", "--none"]
    assert "--none" not in options(find(first)[0])
    with pytest.raises(AssertionError, match="no command 'nothing'"):
        find(second)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_command_that_is_named_exists(page):
    for words in written_commands(page.read_text("utf-8")):
        command, rest = find(words)
        given = {word.partition("=")[0] for word in rest if word.startswith("--")}
        unknown = given - options(command) - {"--help"}
        assert not unknown, f"{' '.join(words)}: no option {', '.join(sorted(unknown))}"


LEAVES = [leaf for program, top in PROGRAMS.items() for leaf in leaves((program,), top)]


@pytest.mark.parametrize(("name", "command"), LEAVES, ids=[name for name, _ in LEAVES])
def test_the_reference_has_every_command_with_every_option(name, command):
    text = sections(COMMANDS_PAGE.read_text("utf-8"))[name]
    lacking = [option for option in sorted(options(command)) if f"`{option}" not in text]
    assert lacking == []


def test_the_reference_lists_every_command():
    text = sections(COMMANDS_PAGE.read_text("utf-8"))["All of them"]
    assert [name for name, _ in LEAVES if f"`{name}" not in text] == []


def test_the_reference_has_the_arguments_and_seeds_of_every_experiment():
    text = sections(COMMANDS_PAGE.read_text("utf-8"))["mmt lab"]
    rows = re.findall(r"^\| `([\w-]+)` \|.*\|([^|]*)\|([^|]*)\|$", text, re.MULTILINE)
    assert {name for name, *_ in rows} == {one.name for one in listed("lab")} - {"stability"}
    for name, arguments, seeds in rows:
        command, _ = find(["mmt", "lab", name])
        defaults = [str(one.default) for one in command.params if "--seeds" in one.opts]
        assert re.findall(r"^\d+", seeds.strip()) == defaults, name
        taken = [one for one in command.params if one.param_type_name == "argument"]
        assert bool(arguments.strip()) == bool(taken), name


def test_the_page_of_devices_names_every_emulated_driver():
    page = (DOCS / "how-to" / "devices.md").read_text("utf-8")
    drivers = {one.name.partition(".")[0] for one in entry_points(group="mmt.devices")}
    emulated = {name for name in drivers if name.startswith("virtual-")}
    assert emulated
    assert {name for name in emulated if f"`{name}`" not in page} == set()


def test_the_stages_of_the_bench_that_are_named_exist():
    stages = {one.name for one in listed("bench")}
    script = (ROOT / "scripts" / "measure_bench").read_text("utf-8")
    measured = {name for line in re.findall(r"mmt bench ([\w ]+)", script) for name in line.split()}
    assert measured <= stages
    text = sections(BENCH_PAGE.read_text("utf-8"))
    described, judged = (
        set(re.findall(r"`(\w+)`", "".join(re.findall(r"^\|([^|]*)", text[part], re.M))))
        for part in ("Stages", "Targets")
    )
    assert described == stages
    assert judged <= stages


def test_there_is_a_row_for_every_example_scene():
    text = (DOCS / "reference" / "example-scenes.md").read_text("utf-8")
    table = re.search(r"<!-- scenes: begin -->(.*?)<!-- scenes: end -->", text, re.DOTALL)
    rows = re.findall(
        r"^\| \[`([\w-]+)`\]\(../../configs/([\w-]+)\.toml\) \|", table[1], re.MULTILINE
    )
    pairs = ("-leader", "-follower")  # one of two machines' scenes: `mmt demo` names both
    alone = {name for name in example_scenes() if not name.endswith(pairs)}
    assert {(name, name) for name in alone} == set(rows)


WALKS = re.findall(r"`(mmt[\w.]+):([\w.]+)`", (DOCS / "architecture.md").read_text("utf-8"))


@pytest.mark.parametrize(("module", "name"), WALKS)
def test_what_the_walks_name_is_there(module, name):
    assert callable(attrgetter(name)(import_module(module)))


def table_rows(text):
    """Return the cells of a table of keys by the key in the first one."""
    rows = {}
    columns = 0
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if cells[0] == "key":
            columns = len(cells)
        key = re.fullmatch(r"`(\w+)`", cells[0])
        if key is not None and len(cells) == columns:
            rows[key[1]] = cells
    return rows


def text_of_table(name):
    """Return what the page says of a table, without the tables inside it."""
    parts = re.split(r"^#{2,3} +(.+?) *$", SCENE_PAGE.read_text("utf-8"), flags=re.M)
    titles = [title.replace("`", "") for title in parts[1::2]]
    return parts[2 + 2 * titles.index(f"[{name}]")]


def keys_of(table):
    """Return the keys of a table, be it a pydantic model or a dataclass."""
    if isinstance(table, type) and issubclass(table, BaseModel):
        return dict(table.model_fields)
    if isinstance(table, type) and is_dataclass(table):
        return {
            field.name: FieldInfo.from_annotated_attribute(
                cast(type[Any], field.type), field.default
            )
            for field in fields(table)
        }
    return {}


def tables_in(keys, prefix=""):
    """Give each table among keys, and those inside it, by its name in a scene."""
    for name, field in keys.items():
        for part in (field.annotation, *get_args(field.annotation)):
            if keys_of(part):
                yield f"{prefix}{name}", part
                if name == "texture":
                    yield from tables_in(keys_of(part), f"{name}.")


TABLES = dict(tables_in(dict(Scene.model_fields)))


def expected_default(field):
    if field.is_required():
        return "required"
    default = field.default
    if default is None:
        return "none"
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    if isinstance(default, tuple):  # corners of a box
        return f"`[{', '.join(str([round(part) for part in corner]) for corner in default)}]`"
    return f"`{default:g}`" if isinstance(default, float) else f"`{default}`"


def expected_in_range(field):
    """Return the bounds and the words that the range must name."""
    bounds = {
        f"{getattr(limit, kind):g}" if getattr(limit, kind) < 2**53 else "2^63"
        for limit in field.metadata
        for kind in ("ge", "gt", "le", "lt", "max_length")
        if getattr(limit, kind, None) is not None
    }
    choices = re.findall(r"Literal\[([^\]]*)\]", str(field.annotation))
    words = {word.strip(" '") for choice in choices for word in choice.split(",")}
    return bounds | words


@pytest.mark.parametrize("table", TABLES)
def test_every_key_is_documented_with_its_default_and_range(table):
    assert "Left out" in text_of_table(table), "and what leaving the table out does"
    rows = table_rows(text_of_table(table))
    keys = keys_of(TABLES[table])
    assert set(rows) == set(keys)
    for key, field in keys.items():
        _, meaning, default, allowed = rows[key]
        assert meaning
        assert default == expected_default(field), key
        plain = re.sub(r"(?<=\d) (?=\d{3}\b)", "", allowed.replace("`", ""))
        written = set(re.findall(r"[\w^.]+", plain))
        missing = {w for w in expected_in_range(field) if w not in written}
        assert not missing, f"{key}: {allowed!r} lacks {missing}"
