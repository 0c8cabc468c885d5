"""The README and the documentation say what the program does."""

import ast
import contextlib
import dataclasses
import io
import json
import re
import runpy
import shlex
from pathlib import Path

import pytest

from cradle_env import CATALOGUE
from identification.cli.app import app, main
from identification.diagnosis.criteria import Criteria
from identification.inference.search_options import SearchOptions
from tests.paths import ROOT

DOCS, README = ROOT / "docs", ROOT / "README.md"
PAGES = [README, ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
SCHEMAS = sorted((ROOT / "identification" / "storage" / "schemas").glob("*.schema.json"))


@pytest.fixture(scope="module")
def parts() -> dict:
    """The generated parts of pages, by name, as text."""
    made = runpy.run_path(str(DOCS / "_ext" / "generated_parts.py"))
    return {name: make() for name, make in made["PARTS"].items()}


def blocks(text: str, language: str) -> list[str]:
    """The code blocks of a page in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def commands(path: Path) -> list[list[str]]:
    """The commands `cradle …` that a page shows, as words."""
    text = path.read_text(encoding="utf-8")
    shown = [*blocks(text, "sh"), *(cell for cell in blocks(text, "{code-cell} ipython3") if "%%bash" in cell)]
    lines = "\n".join(shown).replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("cradle ")]


def test_the_readme_is_a_landing_page():
    assert len(README.read_text(encoding="utf-8").splitlines()) <= 150
    assert (DOCS / "film.gif").stat().st_size < 2_000_000


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_commands_that_a_page_shows_exist(page):
    import typer

    known = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    for name, *words in commands(page):
        command = known[name]
        if inner := getattr(command, "commands", None):
            command = inner[words[0]]
        options = {option for parameter in command.params for option in parameter.opts} | {"--help"}
        assert {word for word in words if word.startswith("--")} <= options, (name, words)


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_to_files(page):
    targets = re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8"))
    missing = [target for target in targets if "://" not in target and not (page.parent / target).exists()]
    assert not missing


def test_the_environment_of_the_readme_does_what_it_says():
    text = README.read_text(encoding="utf-8")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(blocks(text, "python")[0], {})
    assert printed.getvalue() == blocks(text, "text")[0]


@pytest.mark.slow
def test_the_commands_of_the_readme_print_what_it_says(tmp_path, monkeypatch, capsys):
    _, calibrated, diagnosed = blocks(README.read_text(encoding="utf-8"), "text")
    simulate, calibrate, diagnose = commands(README)
    for name, folder, recipe, expected in (
        ("calibrated", "film", (simulate, calibrate), calibrated),
        ("diagnosed", "pendulum", (commands(DOCS / "tutorials" / "what-is-missing.md")[0], diagnose), diagnosed),
    ):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        assert main(recipe[0]) == 0
        file = Path(folder, "experiment.toml")
        text = file.read_text(encoding="utf-8").replace('["quadratic_drag"]', "[]")
        file.write_text(text.replace("quadratic_drag = { c2 = 0.02 }", ""), encoding="utf-8")
        capsys.readouterr()
        assert main(recipe[1]) == 0
        assert " ".join(expected.split()) in " ".join(capsys.readouterr().out.split())


def test_pages_have_the_generated_parts(parts):
    text = "\n".join(page.read_text(encoding="utf-8") for page in DOCS.rglob("*.md"))
    assert set(re.findall(r"<!-- generated: ([\w-]+) -->", text)) == parts.keys()


def test_the_page_of_effects_has_each_effect(parts):
    for effect in CATALOGUE:
        assert f"[`{effect.name}`](#{effect.name})" in parts["effects-overview"]
        section = parts["effects"].partition(f"### `{effect.name}`\n")[2].partition("\n### ")[0]
        told = " ".join(section.replace("\\|", "|").split())
        assert all(" ".join(text.split()) in told for text in (effect.equation, effect.looks_like, effect.reference))
        assert re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE) == [p.key for p in effect.parameters]


def test_the_page_of_the_command_line_has_each_command_and_option(parts):
    import typer

    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        section = parts["command-line"].partition(f"## `cradle {name}`\n")[2].partition("\n## ")[0]
        options = {option for p in command.params for option in p.opts if option.startswith("--") and not p.hidden}
        assert options == set(re.findall(r"^\| `(--[\w-]+)`", section, re.MULTILINE)) - {"--help"}


def test_the_page_on_inference_has_each_threshold_of_a_diagnosis(parts):
    rows = dict(re.findall(r"^\| `(\w+)` \| (\S+) \| \w.{20,} \|$", parts["criteria"], re.MULTILINE))
    assert {name: float(text) for name, text in rows.items()} == dataclasses.asdict(Criteria())


def test_the_page_on_inference_has_each_option_of_the_search(parts):
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]+) \| .{20,} \|$", parts["search-options"], re.MULTILINE))
    assert {name: ast.literal_eval(text) for name, text in rows.items()} == dataclasses.asdict(SearchOptions())


def test_the_page_of_files_has_each_schema(parts):
    for path in SCHEMAS:
        assert f"### {path.name.removesuffix('.schema.json')}\n" in parts["schemas"]


def test_the_page_on_the_paper_has_the_claims_of_the_run_that_is_kept():
    claims = runpy.run_path(str(ROOT / "examples" / "claims.py"))
    text = claims["PAGE"].read_text(encoding="utf-8")
    assert claims["table"]() in text
    assert claims["updated"](text) == text, "run python examples/claims.py --write DIR"


def test_the_page_on_accuracy_has_the_speeds_of_the_bench_that_is_kept():
    """To two digits; where it has a range of several runs, this one is within."""
    kept = json.loads((ROOT / "docs" / "bench.json").read_text(encoding="utf-8"))
    text = (DOCS / "explanation" / "accuracy.md").read_text(encoding="utf-8")
    ours, peer = (
        {row["bobs"]: row for row in kept["races"] if row["integrator"] == name}
        for name in ("cradle_env", "SciPy DOP853, rtol 1e-8")
    )
    steps, seconds = kept["steps_per_second"], kept["seconds"]

    def ends(pattern: str) -> list[tuple[float, float]]:
        """The ranges "A to B" that stand where the pattern has …."""
        found = re.search(re.escape(pattern).replace("…", r"([\d,.]+) to ([\d,.]+)"), text)
        assert found, pattern
        numbers = [float(number.replace(",", "")) for number in found.groups()]
        return list(zip(numbers[::2], numbers[1::2], strict=True))

    ranges = {
        "… × (N = 2), … × (N = 5)": [ours[bobs]["ratio"] for bobs in (2, 5)],
        "… s, … s | `cradle bench`": [seconds["first call, cached"], seconds["first call"]],
        "| … | `cradle bench`": [kept["import_ratio"]],
        "… on one thread, … on two": [rate for name, rate in steps.items() if "1024" in name],
    }
    for pattern, values in ranges.items():
        for (low, high), value in zip(ends(pattern), values, strict=True):
            assert low <= float(f"{value:.2g}") <= high, (pattern, value)
    for bobs in (2, 5):
        errors = (f"{row[bobs]['error']:.1e}".split("e-") for row in (ours, peer))
        raised = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
        told = ", ".join(f"{digits}·10⁻{power.translate(raised)}" for digits, power in errors)
        assert f"N = {bobs}: {told} rad" in text
        ratios = (steps[f"NewtonCradle-v0, {bobs} bobs"] / steps[f"{other}-v1"] for other in ("Pendulum", "Acrobot"))
        assert f"N = {bobs}: {', '.join(f'{ratio:.2g} ×' for ratio in ratios)}" in text
