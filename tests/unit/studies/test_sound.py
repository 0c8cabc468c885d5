"""The study of sound: its page is of what is kept, and its judge tells late clicks from missed ones."""

from studies.kept_rows import read_rows
from studies.sound.__main__ import HERE, results
from studies.sound.made import draw


def test_the_page_is_of_what_is_kept():
    assert (HERE / "results.md").read_text(encoding="utf-8") == results()
    kept = read_rows(HERE / "clicks.jsonl")
    assert len({row["recording"] for row in kept}) == len(kept)


def test_a_recording_is_drawn_by_its_number():
    assert draw(5).release == draw(5).release and draw(5).release != draw(11).release
    assert draw(5).background == draw(11).background
