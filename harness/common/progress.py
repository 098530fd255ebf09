"""Progress on stderr: a bar where the number of steps is known, otherwise a line."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeElapsedColumn, TimeRemainingColumn


@contextmanager
def progress_bar(title: str, total: int, quiet: bool, before: str = "") -> Iterator[Callable[[], None]]:
    """Show a bar with the remaining time while the block runs; yields what to call after each step.

    Before the first step it says ``before``, or the title.
    """
    times, console = ("elapsed", TimeElapsedColumn(), "left", TimeRemainingColumn()), Console(stderr=True)
    columns = "{task.description}", BarColumn(), MofNCompleteColumn(), *times
    with Progress(*columns, console=console, disable=quiet or not console.is_terminal, transient=True) as bar:
        task = bar.add_task(before or title, total=total)

        def advance() -> None:
            bar.update(task, advance=1, description=title)

        yield advance


@contextmanager
def working(what: str, quiet: bool) -> Iterator[None]:
    """Show a line while the block runs; nothing where stderr is no terminal."""
    with nullcontext() if quiet else Console(stderr=True).status(what):
        yield
