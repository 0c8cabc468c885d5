"""JSON Schemas of the files that the program reads back, and checks against them."""

from __future__ import annotations

import functools
import json
from importlib import resources
from pathlib import Path
from typing import Any

from cradle_env.errors import one_line
from identification.storage.files import ExperimentError, read_text

#: Remedy for a file that this program wrote and something else changed.
_REMEDY = "it is not as this program wrote it"


def check_schema(content: Any, name: str, where: str | Path, remedy: str = _REMEDY) -> None:
    """Check content against the schema `name`.

    Raises ExperimentError if it does not match; the message begins with `where` and names the field.
    """
    from jsonschema.exceptions import best_match

    problem = best_match(_validator(name).iter_errors(content))
    if problem is None:
        return
    field = problem.json_path.removeprefix("$").lstrip(".")
    raise ExperimentError(f"{where}: {_describe(field, problem)}; {remedy}")


def read_json(path: Path, name: str, remedy: str = _REMEDY) -> Any:
    """Read a JSON file and check it against the schema `name`.

    Raises ExperimentError, with file and field, if it is not valid JSON or does not match.
    """
    text, _ = read_text(path)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as problem:
        reason = "nested too deep" if isinstance(problem, RecursionError) else str(problem)[:200]
        raise ExperimentError(f"{path}: not valid JSON: {reason}; {remedy}") from None
    check_schema(content, name, path, remedy)
    return content


def parse_json(text: str, name: str, where: str, remedy: str = _REMEDY) -> Any:
    """Parse JSON that is part of a file, and check it as `read_json` does."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise ExperimentError(f"{where}: not valid JSON; {remedy}") from None
    check_schema(content, name, where, remedy)
    return content


def _describe(field: str, problem: Any) -> str:
    """Say in words what is wrong with a field."""
    at, rule, wanted = field or "the content", problem.validator, problem.validator_value
    if rule == "required":
        missing = next(key for key in wanted if key not in problem.instance)
        return f"{f'{field}.' if field else ''}{missing} is missing"
    if rule == "additionalProperties":
        return f"{at} has a key that is not known"
    if rule == "type":
        kinds = [wanted] if isinstance(wanted, str) else wanted
        return f"{at} is {one_line(problem.instance)}; expected {' or '.join(_KINDS[kind] for kind in kinds)}"
    if rule == "const":
        return f"{at} is {one_line(problem.instance)}; expected {one_line(wanted)}"
    if rule == "enum":
        return f"{at} is {one_line(problem.instance)}; expected one of {', '.join(map(one_line, wanted))}"
    expected = problem.schema.get("description", f"{rule} {wanted}")
    return f"{at} is {one_line(problem.instance)}; expected {expected}"


_KINDS = {
    "object": "a table of keys and values",
    "array": "a list",
    "string": "a text",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "null": "null",
}


@functools.cache
def _validator(name: str) -> Any:
    from jsonschema import Draft202012Validator

    text = (
        resources.files("identification.storage").joinpath("schemas", f"{name}.schema.json").read_text(encoding="utf-8")
    )
    return Draft202012Validator(json.loads(text))
