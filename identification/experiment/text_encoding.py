"""Decode text in the encodings that spreadsheets and instruments write."""

from __future__ import annotations

import codecs

from identification.storage.files import ExperimentError

#: Byte order marks and their codecs. UTF-32 is first, since its mark begins with that of UTF-16.
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
#: First bytes of workbooks: zipped (xlsx, ods) and old Excel (xls).
_WORKBOOKS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
#: Number of bytes that are searched for the zeros of UTF-16 without a mark.
_SAMPLE = 1000


def decode(name: str, data: bytes) -> tuple[str, str]:
    r"""Decode the bytes of a file; return the text, with lines ended by \n, and the name of the encoding.

    The encoding is that of the byte order mark, if there is one; UTF-16 if every second byte is zero; UTF-8 if the
    bytes are valid UTF-8; and Windows-1252 (Latin-1) otherwise.

    Raises ExperimentError for workbooks and other binary files.

    >>> decode("run.csv", "θ [°]".encode("utf-16"))
    ('θ [°]', 'UTF-16')
    """
    if data.startswith(_WORKBOOKS):
        raise ExperimentError(f"{name}: is a workbook, not text; save the sheet with the data as CSV")
    text, encoding = _decode(data)
    if "\0" in text:
        raise ExperimentError(f"{name}: is not a text file; export the data as CSV")
    return text.replace("\r\n", "\n").replace("\r", "\n"), encoding


def _decode(data: bytes) -> tuple[str, str]:
    marked = next((codec for mark, codec in _MARKS if data.startswith(mark)), None)
    for codec in (marked or _utf_16_without_mark(data) or "utf-8", "cp1252"):
        try:
            return data.decode(codec), {"cp1252": "Windows-1252"}.get(codec, codec.upper().removesuffix("-SIG"))
        except UnicodeDecodeError:
            continue
    return data.decode("latin-1"), "Latin-1"


def _utf_16_without_mark(data: bytes) -> str | None:
    """Recognize UTF-16 of mostly ASCII characters by its zeros in every second byte."""
    sample = data[:_SAMPLE]
    even, odd = sample[::2].count(0), sample[1::2].count(0)
    if odd > 0.4 * len(sample) and even == 0:
        return "utf-16-le"
    return "utf-16-be" if even > 0.4 * len(sample) and odd == 0 else None
