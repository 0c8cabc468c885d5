"""Parts of pages that Sphinx writes from the program itself: a line `<!-- generated: NAME -->` is where one stands."""

from __future__ import annotations

import inspect
import json
import math
import re
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from cradle_env import CATALOGUE, MODELS, Effect
from cradle_env.effects import FILMED

ROOT = Path(__file__).resolve().parents[2]
SCHEMAS = ROOT / "identification" / "storage" / "schemas"
_MARK = re.compile(r"<!-- generated: ([\w-]+) -->")


def cell(text: str) -> str:
    """A text as one cell of a table."""
    return " ".join(text.split()).replace("|", "\\|")


def table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """A table in Markdown."""
    lines = [header, ("---",) * len(header), *(tuple(map(cell, row)) for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def effects_overview() -> str:
    """One line for each effect of the catalogue, and of what a film states."""
    rows = []
    for effect in (*CATALOGUE, *FILMED):
        models = ", ".join(f"`{name}`" for name, members in MODELS.items() if effect.name in members)
        told = f"{effect.summary} (in {models})" if models else effect.summary
        rows.append((f"[`{effect.name}`](#{effect.name})", told, effect.acts_on))
    return table(("effect", "what it is", "acts on"), rows)


def effects() -> str:
    """A section for each effect: what its declaration says."""
    return "\n\n".join(map(_effect, (*CATALOGUE, *FILMED)))


def _effect(effect: Effect) -> str:
    facts = [
        ("Equation", f"`{effect.equation}`"),
        ("Energy", effect.energy),
        ("In data", effect.looks_like),
        ("Source", effect.reference),
        ("Requires", ", ".join(f"`{name}`" for name in effect.requires)),
        ("Caveat", effect.caveat),
    ]
    lines = [f"({effect.name})=", f"### `{effect.name}`", "", f"{effect.summary[0].upper()}{effect.summary[1:]}.", ""]
    lines += [f"- {name}: {cell(text)}" for name, text in facts if text]
    if effect.parameters:
        lines += [
            "",
            table(("parameter", "unit", "meaning", "absent at", "from", "to", "typical"), _parameters(effect)),
        ]
    return "\n".join(lines)


def _parameters(effect: Effect) -> list[tuple[str, ...]]:
    per = {"": "", "bob": "; one for each bob", "gap": "; one for each gap"}
    return [
        (
            f"`{p.key}`",
            p.unit,
            p.meaning + per[p.each] + ("; their sum is 0" if p.balanced else ""),
            "–" if math.isnan(p.absent) else f"{p.absent:g}",
            f"{p.low:g}",
            f"{p.high:g}",
            f"{p.scale:g}",
        )
        for p in effect.parameters
    ]


def command_line() -> str:
    """A section for each command of `cradle`, from the program that parses the command line."""
    import typer

    from identification.cli.app import app

    group: Any = typer.main.get_command(app)
    context = group.make_context("cradle", [], resilient_parsing=True)
    return "\n\n".join(_command(name, group.get_command(context, name)) for name in group.list_commands(context))


def _command(name: str, command: Any, parents: str = "cradle") -> str:
    called = f"{parents} {name}"
    shown = [parameter for parameter in command.params if not getattr(parameter, "hidden", False)]
    arguments = [parameter for parameter in shown if parameter.param_type_name == "argument"]
    usage = " ".join([called, *map(_metavar, arguments), "[OPTIONS]"])
    lines = [f"({called.replace(' ', '-')})=", f"## `{called}`", "", *_paragraphs(command.help or ""), ""]
    inner = getattr(command, "commands", None)
    if inner:
        return "\n\n".join(["\n".join(lines), *(_command(key, inner[key], called) for key in inner)])
    lines += ["```text", usage, "```", ""]
    rows = [_option(parameter) for parameter in shown]
    return "\n".join([*lines, table(("argument or option", "what it says", "default"), rows)])


def _paragraphs(text: str) -> list[str]:
    return [" ".join(part.split()) + "\n" for part in text.split("\n\n")]


def _metavar(parameter: Any) -> str:
    return parameter.metavar or "VALUE"


def _option(parameter: Any) -> tuple[str, str, str]:
    metavar = _metavar(parameter)
    if parameter.param_type_name == "argument":
        return f"`{metavar}`", getattr(parameter, "help", "") or "", "required"
    name = f"`{', '.join(parameter.opts)}`" + ("" if getattr(parameter, "is_flag", False) else f" `{metavar}`")
    default = parameter.show_default if isinstance(parameter.show_default, str) else parameter.default
    told = "required" if parameter.required else "" if default is None or default is False else f"{default}"
    return name, parameter.help or "", told


def schemas() -> str:
    """A section for each file that has a JSON Schema: what its keys are."""
    return "\n\n".join(_schema(path) for path in sorted(SCHEMAS.glob("*.schema.json")))


def _schema(path: Path) -> str:
    content = json.loads(path.read_text(encoding="utf-8"))
    link = f"{{download}}`{path.name} <../../{path.relative_to(ROOT)}>`"
    lines = [f"### {path.name.removesuffix('.schema.json')}", "", f"{content['title']}: {link}.", ""]
    rows = list(_keys(content, ""))
    return "\n".join([*lines, table(("key", "type", "what it is"), rows)] if rows else lines)


def _keys(schema: dict[str, Any], prefix: str) -> Iterator[tuple[str, str, str]]:
    """A row for each key of an object, its own keys below it."""
    required = schema.get("required", ())
    for key, inner in schema.get("properties", {}).items():
        name = f"{prefix}{key}"
        yield f"`{name}`" + ("" if key in required else " (optional)"), _kind(inner), inner.get("description", "")
        items = inner.get("items", {})
        yield from _keys(inner, f"{name}.")
        if isinstance(items, dict):
            yield from _keys(items, f"{name}[].")


def _kind(schema: dict[str, Any]) -> str:
    if "const" in schema:
        return f"`{json.dumps(schema['const'])}`"
    if "enum" in schema:
        return " or ".join(f"`{json.dumps(value)}`" for value in schema["enum"])
    if "$ref" in schema:
        return schema["$ref"].rpartition("/")[2].replace("_", " ")
    if "anyOf" in schema or "oneOf" in schema:
        return " or ".join(map(_kind, schema.get("anyOf") or schema["oneOf"]))
    kinds = schema.get("type", "any")
    text = kinds if isinstance(kinds, str) else " or ".join(kinds)
    inner = schema.get("items")
    return f"{text} of {_kind(inner)}" if isinstance(inner, dict) and inner else text


def import_contracts() -> str:
    """Who may import whom: the contracts that import-linter checks."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    return "\n\n".join(map(_contract, tomllib.loads(text)["tool"]["importlinter"]["contracts"]))


def _contract(contract: dict[str, Any]) -> str:
    name = f"**{contract['name']}**"
    if contract["type"] == "layers":
        return "\n".join([name, "", *(f"- `{layer}`" for layer in contract["layers"])])
    if contract["type"] != "forbidden":
        return f"{name}."
    sources, forbidden = (
        ", ".join(f"`{module}`" for module in contract[key]) for key in ("source_modules", "forbidden_modules")
    )
    return f"{name}: {sources} must not import {forbidden}."


def criteria() -> str:
    """A row for each threshold of a diagnosis."""
    from identification.diagnosis.criteria import Criteria

    return options_table(Criteria)


def search_options() -> str:
    """A row for each option of the inference."""
    from identification.inference.search_options import SearchOptions

    return options_table(SearchOptions)


def options_table(options: type) -> str:
    """A row for each field of a dataclass of options: its default, and what its NumPy docstring says of it."""
    assert is_dataclass(options)
    section = re.search(r"Parameters\n-{10}\n(.*?)(?=\n\S+\n-{3,}\n|\Z)", inspect.getdoc(options) or "", re.DOTALL)
    assert section is not None
    meanings: dict[str, str] = {}
    for names, text in re.findall(r"^(\w[^:\n]*) : .*\n((?:    .*\n?|\n)+)", section[1], re.MULTILINE):
        meanings |= dict.fromkeys(names.split(", "), text)
    return table(
        ("field", "default", "meaning and reason"),
        [(f"`{f.name}`", f"{f.default}", meanings[f.name]) for f in fields(options)],
    )


def engines() -> str:
    """A row for each engine of the bench that is kept, and each of its settings."""
    rows = json.loads((ROOT / "docs" / "bench.json").read_text(encoding="utf-8"))["engines"]
    return table(
        ("bobs", "engine", "setting", "simulated per processor time", "the same, sampled", "largest error of θ (rad)"),
        [
            (
                *(str(row[name]) for name in ("bobs", "engine", "setting")),
                *(f"{row[name]:,.0f}" for name in ("speed", "speed_sampled")),
                f"{row['error']:.1e}",
            )
            for row in rows
        ],
    )


PARTS: dict[str, Callable[[], str]] = {
    "criteria": criteria,
    "engines": engines,
    "search-options": search_options,
    "effects-overview": effects_overview,
    "effects": effects,
    "command-line": command_line,
    "schemas": schemas,
    "import-contracts": import_contracts,
}


def filled(text: str) -> str:
    """A page with its generated parts in their places."""
    return _MARK.sub(lambda mark: PARTS[mark[1]](), text)


def _plain(_app: Any, what: str, _name: str, documented: Any, _options: Any, lines: list[str]) -> None:
    """Absolute values in docstrings are no substitutions, and what a property says before a colon is no type."""
    if what == "property":
        lines[:] = (inspect.getdoc(documented) or "").splitlines()
    lines[:] = [line.replace("|", "\\|") for line in lines]


def setup(app: Any) -> dict[str, Any]:
    """Fills each page as Sphinx reads it."""
    app.connect("source-read", lambda _app, _name, source: source.__setitem__(0, filled(source[0])))
    app.connect("autodoc-process-docstring", _plain, priority=600)  # after napoleon
    return {"parallel_read_safe": True, "parallel_write_safe": True}
