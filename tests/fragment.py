"""What a notebook would make of the HTML of an object."""

import html.parser
import re

#: Elements that need no end.
_VOID = ("img", "br")


class Fragment(html.parser.HTMLParser):
    """A piece of HTML: texts of its table cells by row, its images; it must close its elements and run nothing."""

    def __init__(self, text: str):
        super().__init__()
        self.open, self.images, self.rows, self.caption = [], [], [], ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        assert tag not in ("script", "iframe", "object", "embed", "link", "style", "form")
        for name, value in attrs:
            assert not name.startswith("on"), f"{name} handles an event"
            assert not re.match(r"\s*javascript:", value or "", re.IGNORECASE)
            assert name not in ("href", "src") or value.startswith("data:image/png;base64,")
        if tag == "img":
            self.images.append(dict(attrs))
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag not in _VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "caption" in self.open:
            self.caption += data
        elif {"td", "th"} & set(self.open):
            self.rows[-1][-1] += data
        else:
            assert not data.strip()
