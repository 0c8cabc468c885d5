"""Tables in ZIP files, as phyphox exports them: the CSV of the measurement, and CSVs about the phone under meta/."""

from __future__ import annotations

import io
import zipfile
import zlib
from pathlib import PurePosixPath

from identification.storage.files import LARGEST, ExperimentError

_ZIP = b"PK\x03\x04"
#: A member of every Office workbook, and one of every OpenDocument.
_WORKBOOK = ("[Content_Types].xml", "mimetype")
#: What `zipfile` raises for damaged, encrypted and unknown members.
_DAMAGED = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError, ValueError)
_TABLES = (".csv", ".txt", ".tsv")


def is_zip(data: bytes) -> bool:
    """Whether a file is zipped, be it an archive or a workbook."""
    return data.startswith(_ZIP)


def unzip_table(name: str, data: bytes) -> tuple[str, bytes]:
    """The one table in a ZIP file, as (its name, its bytes); other files stay as they are.

    Raises ExperimentError if the ZIP file is damaged, or has no table or several.
    """
    if not is_zip(data):
        return name, data
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = archive.infolist()
            if any(member.filename in _WORKBOOK for member in members):
                return name, data
            tables = [member for member in members if _is_table(PurePosixPath(member.filename))]
            if len(tables) != 1:
                found = ", ".join(repr(member.filename[:60]) for member in tables[:8]) or "no table"
                raise ExperimentError(f"{name}: holds {found}; unpack it, and name the CSV with the motion of the bobs")
            if tables[0].file_size > LARGEST:
                raise ExperimentError(f"{name}: its table is larger than {LARGEST >> 20} MB; export fewer readings")
            return f"{name}/{PurePosixPath(tables[0].filename).name}", archive.read(tables[0])
    except ExperimentError:
        raise
    except _DAMAGED as problem:
        raise ExperimentError(f"{name}: a damaged ZIP file ({str(problem)[:80]}); export it again") from None


def _is_table(path: PurePosixPath) -> bool:
    hidden = path.parts[:1] == ("__MACOSX",) or path.name.startswith(".")
    return path.suffix.lower() in _TABLES and "meta" not in path.parts[:-1] and not hidden
