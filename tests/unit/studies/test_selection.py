"""The page of the study of selections."""

from studies.kept_rows import read_rows
from studies.selection.__main__ import HERE
from studies.selection.table import write_page


def test_the_page_is_made_of_the_kept_rows(tmp_path):
    write_page(read_rows(HERE / "results.jsonl"), tmp_path / "results.md")
    assert (tmp_path / "results.md").read_text(encoding="utf-8") == (HERE / "results.md").read_text(encoding="utf-8")
