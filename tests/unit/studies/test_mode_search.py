"""The study of the search for modes: its page is of what is kept, and counts rightly."""

from studies.kept_rows import read_rows
from studies.mode_search.__main__ import PAGE, ROWS, page


def test_the_page_is_of_what_is_kept() -> None:
    rows = read_rows(ROWS)
    assert PAGE.read_text(encoding="utf-8") == page(rows)
    assert len({(row["cradle"], row["code"]) for row in rows}) == len(rows)


def test_a_mode_is_wrong_by_its_largest_error() -> None:
    of = {"code": "new", "bobs": 3, "rate": 60.0}
    errors = ({"k_f": 0.5, "kappa": -2.5, "b": 0.1}, {"k_f": 0.3, "kappa": 0.2, "b": -7.25})
    told = page([{"cradle": k, **of, "errors": one} for k, one in enumerate(errors)])
    half, all_ = "1 of 2, 50 % (1.3 to 98.7 %)", "2 of 2, 100 % (16 to 100 %)"
    assert f"| new | 3 | {half} | {all_} | {half} | {half} |" in told
    assert "| new | 1 | 3 | 60 | +0.3 | +0.2 | -7.2 |" in told and "| new | 0 |" not in told
