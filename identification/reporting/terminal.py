"""Terminal output: tables on stdout, progress of long tasks on stderr."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Sequence

#: Time between two lines of progress if stderr is no terminal [s].
_REPORT_INTERVAL = 10.0


def print_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table at its full width, because a pipe has none. A narrow terminal wraps it."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        table.add_column(column, no_wrap=True)
    for row in rows:
        table.add_row(*row)
    Console(width=200, markup=False, highlight=False).print(table, soft_wrap=True)


class TerminalProgress:
    """A context manager that shows `progress(stage, fraction, text)`; fraction None means unknown."""

    def __enter__(self) -> TerminalProgress:
        self._began = self._told = time.monotonic()
        self._bars, self._tasks = None, {}
        if sys.stderr.isatty():
            from rich import progress
            from rich.console import Console
            from rich.table import Column

            self._bars = progress.Progress(
                progress.TextColumn("{task.description}", table_column=Column(no_wrap=True, min_width=8)),
                progress.BarColumn(16),
                progress.TaskProgressColumn(),
                progress.TimeRemainingColumn(compact=True),
                progress.TextColumn(
                    "{task.fields[text]}", markup=False, table_column=Column(no_wrap=True, overflow="ellipsis", ratio=1)
                ),
                console=Console(stderr=True),
                transient=True,
                expand=True,
            )
            self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bars is not None:
            self._bars.stop()

    def __call__(self, stage: str, fraction: float | None, text: str = "") -> None:
        """Show the stage, the fraction done, and a text such as a rate."""
        if self._bars is not None:
            if stage not in self._tasks:
                for earlier in self._tasks.values():
                    self._bars.update(earlier, visible=False)
                self._tasks[stage] = self._bars.add_task(stage, total=None, text=text)
            total = None if fraction is None else 1.0
            self._bars.update(self._tasks[stage], completed=fraction or 0.0, total=total, text=text)
            return
        now = time.monotonic()
        if now - self._told >= _REPORT_INTERVAL:
            self._told = now
            share = "" if fraction is None else f" {100.0 * fraction:.0f} %"
            print(f"{stage}{share}: {text} ({now - self._began:.0f} s elapsed)", file=sys.stderr, flush=True)
